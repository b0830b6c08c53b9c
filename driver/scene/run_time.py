"""What ends a scene while FreeFEM runs it, in one line of a user's words.

A run that is traced names each macro of the scene before it evaluates it (declarations.py).
"""

import re
from pathlib import Path

from ..text import ends
from . import declarations, grammar, rooms

SILENT = "current line|^ConnectedComponents "  # output that says nothing of what is wrong
EVALUATING = re.compile(rf"^{declarations.EVALUATING}(.*)$", re.MULTILINE)
SAME_PLACE = re.compile(r"double points in\s+s = \d+ \(\[[^]]*\],\[([^]]*)\]")
APART = "mesh bodies that touch one at a time and join them by addBody(...)"
# what a run-time message of FreeFEM means for a scene
MEANINGS = (
    (r"Div by 0", "a division by zero"),
    (r"Optimized version", "a number that is none (NaN), as from sqrt of a negative one"),
    (r"exec assert", "an assert that does not hold"),
    (r"triangles was reverse", "movemesh turns triangles over or makes them flat"),
    (r"Error mshptg8_|max nb points", "a mesh without cells: square needs one cell a side at "
                                      "least; is the element size (H) far too large? trunc needs "
                                      "a region that the mesh has"),
    (r"boundary is not closed", "borders that do not close a curve"),
    (r"boundary is crossing", "borders that cross one another"),
    (r"wrong direction", "a border that runs the wrong way round, as the body must lie on its "
                         "left, or one without elements: is the element size (H) too large?"),
    (r"Assertion fail : \(&?Thh?\)", "a mesh that has not been made: rectangle(...) leaves that to "
                                     "export.idp, which knows CELLS and SUBDOMAINS"),
    (r"Assertion fail|missing vertices", "a mesh that FreeFEM cannot work with: triangles that are "
                                         "flat or overlap, vertices that coincide or are NaN"),
    (r"(?s:mesh generator.*call gmshBody)", "triangles or edges that are there twice or overlap, "
                                            f"as of bodies in one file: {APART}"),
    (r"mesh generator", "a mesh with triangles or edges that are there twice, overlap, are flat or "
                        "run clockwise, or with vertices that coincide"),
    (r"Mesh IO Error|Erreur Lecture", "a mesh file that is damaged or not there"),
    (r"Strange catch exception", "not enough memory for a mesh of this size: is the element size "
                                 "(H) far too small, or is CELLS or SUBDOMAINS far too large?"))

KILLED = {6: "not enough memory?", 9: "was there enough memory?", 25: "a file beyond 'ulimit -f'",
          11: "a mesh that is far too fine (H, CELLS, SUBDOMAINS), vertices that no triangle uses "
              "(from gmsh: curves of a surface without a Physical Surface), or a NaN for a value"}
OUTSIDE = (2, 9, 15, 25)  # signals that no statement of a scene is the cause of


def ended(output: str, status: int, scene: Path, retrace) -> str:
    """What ended the script."""
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    killed = -status if status < 0 else status - 128 if status > 128 else 0
    said = ends(dict.fromkeys(line for line in lines
                              if line.startswith(("Exec error", "Error", "Fatal error"))))
    number = (re.search(r"call gmshBody +at +line +(\d+)", output)
              or re.search(r"current line = (\d+)", output))
    if "dlerror" in output:
        name = (re.findall(r"dlerror : (\S+?)\.so", output) or [""])[0]
        return f"{grammar.place(scene, rf'load.*{name}')}: FreeFEM has no plugin {name}"
    if same := SAME_PLACE.search(output):
        file = grammar.place(scene, "[.](geo|msh)")
        return f"{file}: two points of the mesh at ({same[1]}): {APART}"
    meaning = next((words for pattern, words in MEANINGS if re.search(pattern, output)), "")
    if killed:
        said = f"FreeFEM was killed by signal {killed}"
        meaning = meaning or KILLED.get(killed, "")
    said = said or next((line for line in lines if not re.search(SILENT, line)), "no message")
    reason = f"{meaning} ({said})" if meaning else said
    traced = [] if killed in OUTSIDE else EVALUATING.findall(retrace())
    bodies, now = traced.count("addBody"), traced[-1] if traced else ""
    if now in rooms.vocabulary() and "end" not in traced:
        place = grammar.place(scene, rf"macro {now}\b")
        if now == "obstacle" and "Div by 0" in output:
            reason = ("it is the same everywhere about a place where it is asked for, and gives no "
                      "direction there")
        return f"{place}: {now} cannot be evaluated: {reason}"
    body = grammar.uses(scene, "addBody", bodies - 1) if bodies and now == "addBody" else ""
    line, last = re.search(r" line (\d+)$", body), len(grammar.sources(scene)[0].code)
    # no line further on in the scene; those of the library's own are beyond its end
    if body and not (line and number and int(line[1]) < int(number[1]) <= last):
        return f"{body}: this body cannot be made: {reason}"
    where = scene.name
    if number and ("export" not in traced or now == "end"):
        where = at(scene, int(number[1]), meshed="Exec error" not in output)
    return f"FreeFEM failed in {where} (exit {status}): {reason}"


def at(scene: Path, number: int, meshed: bool) -> str:
    """The files that have a line of this number; where it draws a border that is `meshed`, where.

    It is one of a file of the library where the scene's own have not as many.
    """
    sources = [source for source in grammar.sources(scene) if len(source.code) >= number]
    for source in sources:
        border = meshed and re.match(r"\s*border\s+(\w+)", source.code[number - 1])
        code = "\n".join(source.code)
        for mesh in re.finditer(r"\bbuildmesh\b[^;]*", code) if border else ():
            if re.search(rf"\b{border[1]}\b", mesh[0]):
                return f"{source.path.name} line {code.count(chr(10), 0, mesh.start()) + 1}"
    return " or ".join(f"{source.path.name} line {number}" for source in sources) or scene.name
