"""``python3 -m driver``: see cli.py."""

from .cli import main

main()
