"""The FreeFEM side: run a scene, read its export and refuse what is not sound.

What effects a scene can declare is read from the heads of edp/lib/effects (rooms.py).
"""
