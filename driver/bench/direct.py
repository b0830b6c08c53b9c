"""A scene's linear problem as a plain FreeFEM script: one mesh, one load case, one factorization.

The script is the scene up to its last line, so that the mesh is the suite's; then come one space
on the whole body, its stiffness, the loads at the end time, and MUMPS, sequential, for a symmetric
positive matrix. Contact and friction are left out.
"""

import re
from pathlib import Path

from .. import children
from ..errors import InputError
from ..scene import declarations

LAST = re.compile(r'^\s*include\s+"export\.idp".*$', re.MULTILINE)
MACRO = re.compile(r"^\s*macro\s+(\w+)\s*\(", re.MULTILINE)
UNKNOWN = ("contactPair", "c11", "thermal", "pointLoad", "axisymmetric")
SOLVED = """
mesh Ti = body;
macro measured(f) f //
bodyLabels.resize(0);
{ int[int] found = labels(body); bodyLabels.resize(found.n); bodyLabels = found; }
load "MUMPS_seq"
fespace Whole(Ti, [ELEMENT, ELEMENT]);
if (flagPosition("count") > 0) { cout << "dofs " << Whole.ndof << endl; exit(0); }
macro directLame() (LAME) //
macro directShear() ((young)/(2*(1 + (poisson)))) //
Whole [directU, directV];
varf directForm([u1, u2], [v1, v2]) = int2d(Ti)(directLame*(dx(u1) + dy(u2))*(dx(v1) + dy(v2))
    + directShear*(2*dx(u1)*dx(v1) + 2*dy(u2)*dy(v2) + (dy(u1) + dx(u2))*(dy(v1) + dx(v2))))
    SUPPORTS;
matrix directK = directForm(Whole, Whole, sym = 1, positive = 1, solver = sparsesolver);
real[int] directForce(Whole.ndof);
directForce = 0;
LOADS
directU[] = directK^-1*directForce;
int directWritten = flagPosition("written");
if (directWritten > 0) {
  ofstream out(ARGV[directWritten]);
  out.precision(17);
  for (int i = 0; i < Ti.nv; ++i)
    out << Ti(i).x << " " << Ti(i).y << " " << directU(Ti(i).x, Ti(i).y) << " "
        << directV(Ti(i).x, Ti(i).y) << endl;
}
"""
LOAD = """
{ varf linear([u1, u2], [v1, v2]) = FORM;
  real[int] directPart = linear(0, WholeTGV);
  directPart *= FACTOR;
  directForce += directPart; }
"""
PENALTY = 1e30  # FreeFEM's own for fixed dofs
LAME = {False: "(young)*(poisson)/((1 + (poisson))*(1 - 2*(poisson)))",
        True: "(young)*(poisson)/(1 - (poisson)^2)"}  # plane strain, plane stress


def text(scene: Path, element: str) -> str:
    """The script for the linear problem of `scene`, with P1 or P2 elements.

    Raises InputError for several bodies and for what the script knows nothing of.
    """
    given = scene.read_text()
    names = MACRO.findall(given)
    bad = [name for name in names if name.rstrip("123456789") in UNKNOWN]
    if bad or "addBody" in given or "rectangle" in given or not LAST.search(given):
        raise InputError(f"{scene.name} is no scene of one body on a mesh of its own that "
                         f"supports and forces alone act on {', '.join(bad)}")
    supports = [name for name in names if re.fullmatch(r"support|displacement\d", name)]
    loads = [_load(name, names) for name in names
             if re.fullmatch(r"(load|bodyForce|displacement)\d", name)]
    solved = SOLVED.replace("ELEMENT", element).replace("LAME", LAME["planeStress" in names])
    solved = solved.replace("SUPPORTS", " ".join(f"+ {name}" for name in supports))
    return LAST.sub(lambda _: solved.replace("LOADS", "".join(loads)), given)


def _load(name: str, names: list[str]) -> str:
    """Statements that add a load at the end time to the right-hand side."""
    kind, number = name[:-1], name[-1]
    form = f"int2d(Ti)(({name})'*[v1, v2])" if kind == "bodyForce" else name
    factor = f"amplitude{number}(timeEnd)" if f"amplitude{number}" in names else "1."
    moved = kind == "displacement"
    if moved:
        factor = f"{PENALTY:g}*({factor})"
    return (LOAD.replace("FORM", form).replace("FACTOR", factor)
            .replace("TGV", ", tgv = 1." if moved else ""))


def command(scene: Path, element: str, h: float, folder: Path,
            *words: str) -> tuple[list[str], dict]:
    """Command line that runs the script, written to `folder`, and options of its process.

    A mesh far finer than the scene's is meant, and not counted first.
    """
    folder.mkdir(parents=True, exist_ok=True)
    declarations.write(folder)
    script = folder / "direct.edp"
    script.write_text(text(scene, element))
    env = children.child_environment()
    env |= {"EXPORT_DIRECTORY": str(folder), "SIZE_FIELD": "",
            "FF_INCLUDEPATH": f"{folder.absolute()};{env['FF_INCLUDEPATH']}"}
    return ([children.program("FreeFem++"), "-nw", "-ns", "-v", "0", str(script), "-export",
             str(folder), "-h", str(h), "-counted", "1", *words], {"env": env, "cwd": scene.parent})
