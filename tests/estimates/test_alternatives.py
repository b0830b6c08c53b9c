"""Other kinds of meshes beside a run, on manufactured runs: value 2 + c h^p + d stride."""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.errors import NotConverged
from driver.estimates import alternatives
from driver.estimates.alternatives import ADAPTIVE, RATE, Alternatives
from driver.estimates.budget import Part
from driver.estimates.free_peak import Peaks
from driver.estimates.prices import Measured

OF_MESH = {"P1": (0.4, 1.0), "P2": (0.1, 2.0), "P2-mixed": (0.1, 2.0)}  # c, p
OF_TIME = 0.03
DENSITY = {"P1": 3.0, "P2": 7.0, "P2-mixed": 7.0}  # nodes in a unit square, at a unit size
REFINED = 0.5  # size of an element of the refined mesh, over that of its start


class Scene:
    """What Alternatives asks of companions and their levels, for elements of a length."""

    def __init__(self, element="P1", knob="h", size=1.0, meshes=3, cycles=0, failing=()):
        self.element, self.knob, self.failing, self.base = element, knob, failing, {}
        sizes = [size * (2.0**k if knob == "h" else 0.5**k) for k in range(meshes)]
        self.meshes = [{}, *({knob: s} for s in sizes[1:])]
        if cycles:
            self.meshes = [{}, *({"cycle": k} for k in reversed(range(cycles)))][:3]
        self.size, self.refined = size, ["a folder"] * cycles
        self.strides = SimpleNamespace(of_coarse_meshes=2, up_to=lambda wanted: wanted,
                                       misses=lambda stride: False)
        self.manifest = SimpleNamespace(parameters={knob: size}, element=element)
        self.manifest.nodes = self.nodes({})
        self.values, self.levels, self.spent = {"slip": self.value({}, 1)}, self, {}
        self.asked = []

    def length(self, mesh):
        """Of the elements of a mesh."""
        if "cycle" in mesh:  # of those before the run's own
            return self.size * 2.0 ** (len(self.refined) - mesh["cycle"])
        size = mesh.get(self.knob, self.size)
        size = mesh.get("refined", size)
        length = size if self.knob == "h" else 1 / size
        return length * (REFINED if "refined" in mesh else 1.0)

    def value(self, mesh, stride):
        c, p = OF_MESH[mesh.get("element", self.element)]
        return 2.0 + c * self.length(mesh) ** p + OF_TIME * stride

    def level(self, mesh, stride=1, quiet=False):
        self.asked.append((mesh, stride, quiet))
        if any(all(mesh.get(name) == value for name, value in one.items())
               for one in self.failing):
            return None
        self.spent[tuple(sorted(mesh.items()))] = {"export": self.length(mesh), "setup": 0.25}
        return SimpleNamespace(values={"slip": self.value(mesh, stride)}, seconds=10.0 / stride,
                               declared=12 // stride)

    def nodes(self, mesh):
        return DENSITY[mesh.get("element", self.element)] / self.length(mesh) ** 2

    def problem(self, **mesh):
        return SimpleNamespace(manifest=SimpleNamespace(nodes=self.nodes(mesh)))

    def kinds(self, refine=True, error=0.25, rate=1.5):
        run = Measured(2 * self.nodes({}), 12,
                       {"export": 1.0, "setup": 1.0, "solve": 10.0, "output": 1.0})
        of = Alternatives(self, {"mesh": {"slip": Part(error, rate=rate)}}, "slip", run)
        start = self.meshes[-1]

        def refined(mesh, begun):
            assert mesh == begun == start
            if not refine:
                raise NotConverged("too coarse")
            key = {"refined": mesh.get(self.knob, self.size)}
            return self.level(key, 4), key

        def begun(mesh):
            self.asked.append(("refined mesh", 1, True))
            return mesh

        of._begun, of._refine = begun, refined
        return of, {kind.name: kind for kind in of.kinds()}


def apart(scene, one, other, stride):
    return abs(scene.value(one, stride) - scene.value(other, stride))


@pytest.mark.parametrize("meshes", [1, 2, 3])
def test_the_own_kind_adds_up_distances_of_meshes_in_the_same_steps(meshes):
    scene = Scene(meshes=meshes, size=0.5)
    of, kinds = scene.kinds()
    own, sizes = kinds["P1"], [0.5, 1.0, 2.0][:meshes]
    steps = [apart(scene, {"h": a}, {"h": b}, 1) for a, b in zip(sizes, sizes[1:])]
    assert own.sizes == sizes and own.rate == 1.5 and own.words == {}
    assert own.errors == pytest.approx([0.25 + sum(steps[:k]) for k in range(meshes)])
    assert own.unknowns == [2 * 3.0 / size**2 for size in sizes]  # two displacements a node
    # coarser meshes in all steps, the coarsest in every second one
    took = [Measured(2 * 3.0 / h**2, 12 // stride,
                     {"export": h, "setup": 0.25, "solve": 10.0 / stride})
            for h, stride in zip(sizes[1:], (1, 2))]
    assert of.took["P1"] == took


@pytest.mark.parametrize("element, other, sizes, large", [
    ("P1", "P2", [2.0, 4.0], 0), ("P2", "P1", [0.5, 1.0], 1e9), ("P2", "P1", [1.0, 2.0], 0)])
def test_the_other_order_is_run_where_its_errors_are_alike(element, other, sizes, large,
                                                           monkeypatch):
    """Quadratic elements four and eight times as long, linear ones as long and twice so, of large
    runs twice and four times; between the distance from the run and that and its error whatever
    their own two meshes say.
    """
    monkeypatch.setattr(alternatives, "LARGE", large)
    scene = Scene(element, size=0.5)
    of, kinds = scene.kinds(error=0.01)
    kind = kinds[other]
    values = [scene.value({"h": h, "element": other}, 4) for h in sizes]
    away = abs(values[0] - scene.value({}, 4))  # steps of both are the same
    assert kind.sizes == sizes and kind.words == {"ELEMENT": other} and kind.rate == RATE
    assert away - 1e-12 <= kind.errors[0] <= away + 0.01 + 1e-12
    assert kind.errors[1] - kind.errors[0] == pytest.approx(abs(values[0] - values[1]))
    assert kind.unknowns == pytest.approx([2 * DENSITY[other] / h**2 for h in sizes])
    assert of.took[other] == [Measured(2 * DENSITY[other] / h**2, 3, {
        "export": h, "setup": 0.25, "solve": 2.5}) for h in sizes]
    assert kinds[element].words == ({} if element == "P1" else {"ELEMENT": element})
    # one that fails is no news to the user: the run itself is not concerned
    first = {mesh["h"]: quiet for mesh, _, quiet in scene.asked[::-1] if "element" in mesh}
    assert list(first.values()) == [True] * len(sizes)


def test_linear_elements_on_the_run_s_mesh_are_no_better_than_its_quadratic_ones():
    """Whatever their distance from the run is by chance; coarser ones are farther away."""
    scene = Scene("P2", size=0.5)
    scene.value = lambda mesh, stride: 2.0 + 0.01 * (mesh.get("h") == 1.0)
    kinds = scene.kinds(error=0.5)[1]
    assert kinds["P1"].errors == pytest.approx([0.5, 0.51])


@pytest.mark.parametrize("held, name, least", [
    (2.0, "displacement", 0.05), (1.97, "displacement", 0.05), (1.9, "displacement", 0.0),
    (2.0, "slip", 0.0)])
def test_a_displacement_that_a_support_prescribes_is_no_accuracy(held, name, least, monkeypatch):
    """All meshes agree on it, or on little more; others may exceed it by 2.5 %."""
    found = Peaks(2.0, held, np.zeros((0, 4)), held=held)
    monkeypatch.setattr(Peaks, "of_level", lambda level: found)
    of = Scene("P1").kinds()[0]
    of.name = name
    assert of._unseen(None) == pytest.approx(least)


@pytest.mark.parametrize("cells, expected", [(12, [3, 2]), (5, [2, 1]), (3, [1]), (1, [1])])
def test_coarse_meshes_end_where_one_cell_is_left(cells, expected):
    scene = Scene(knob="cells", size=cells, meshes=1)
    assert scene.kinds()[1]["P2"].sizes == expected


def test_kinds_that_cannot_be_had_are_left_out():
    """Of the other order those meshes that can be run; elements against locking have no other."""
    def names(scene, **more):
        return set(scene.kinds(**more)[1])

    assert names(Scene()) == {"P1", "P2", "ADAPT"}
    assert names(Scene(), refine=False) == {"P1", "P2"}
    assert names(Scene("P2-mixed")) == {"P2-mixed", "ADAPT"}
    assert names(Scene(failing=[{"element": "P2"}])) == {"P1", "ADAPT"}
    one = Scene(failing=[{"element": "P2", "h": 4.0}]).kinds()[1]["P2"]
    assert one.sizes == [8.0] and len(one.errors) == 1


def test_a_refined_mesh_goes_on_from_the_coarsest():
    """Two displacements a node, an order by the degree of its elements, costs of its kind."""
    for element, words in (("P1", {}), ("P2", {"ELEMENT": "P2"})):
        scene = Scene(element, size=0.5)
        of, kinds = scene.kinds(error=0.01)
        kind, own = kinds["ADAPT"], kinds[element]
        assert kind.settings == {"H": "2", **words} and kind.rate == ADAPTIVE[len(words) + 1]
        assert kind.unknowns == pytest.approx([2 * DENSITY[element] / h**2 for h in (2.0, 1.0)])
        assert kind.errors[0] == own.errors[-1]
        # nothing is known of it but its distance from the run, and the run's error
        away = abs(scene.value({"refined": 2.0}, 4) - scene.value({}, 4))
        assert kind.errors[1] == pytest.approx(away + 0.01)
        assert of.took["ADAPT"] == [Measured(kind.unknowns[1], 3, {
            "export": 1.0, "setup": 0.25, "solve": 2.5})]
        for each in kinds.values():  # all have the run's constant, their own factors
            assert each.costs.run(1e4, 10) > 0


def test_a_refined_mesh_is_made_while_other_elements_are_run():
    scene = Scene("P1")
    scene.kinds()
    meshes = [mesh for mesh, *_ in scene.asked]
    assert meshes.index("refined mesh") < min(k for k, m in enumerate(meshes) if "element" in m)


@pytest.mark.parametrize("cycles", [1, 2, 3, 4])
@pytest.mark.parametrize("element, words", [("P1", {}), ("P2", {"ELEMENT": "P2"})])
def test_a_refined_run_goes_on_from_its_cycles(cycles, element, words):
    """Errors of the last three meshes, as that of the first of them before; unknowns of all."""
    scene = Scene(element, cycles=cycles)
    of, kinds = scene.kinds()
    (kind,) = kinds.values()
    meshes = [{"cycle": k} for k in range(cycles)] + [{}]
    known = meshes[-3:]
    errors = [0.25 + sum(apart(scene, a, b, 1) for a, b in zip(known[k:], known[k + 1:]))
              for k in range(len(known))]
    assert kind.errors == pytest.approx([errors[0]] * (len(meshes) - len(known)) + errors)
    assert kind.unknowns == pytest.approx([2 * scene.nodes(mesh) for mesh in meshes])
    assert kind.settings == {"H": "1", **words} and kind.rate == 1.5 and kind.name == "ADAPT"
    assert kind.costs.run(1e4, 10) > 0 and not of.took
