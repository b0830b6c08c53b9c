"""Rooms: what the heads of edp/lib/effects say, and exports of scenes of which effects are left
out.
"""

import re

import pytest

from driver import environment
from driver.errors import InputError
from driver.scene import declarations, freefem, rooms, seal
from driver.scene.manifest import read_manifest

DRIVEN = (("macro load1() traction(3, 0., -10e7) + traction(2, 3e7, 5e7) //",
           "macro load1() traction(3, 0., -10e7) //\nmacro load2() traction(2, 3e7, 5e7) //\n"
           "macro amplitude2(t) t^2 //"),)


def test_every_room_says_how_it_is_declared():
    for room in rooms.rooms():
        assert room.title.endswith(".")
        assert set(room.declared_by) <= {macro.name for macro in room.macros}
        assert all(macro.text for macro in room.macros), room.name
        assert re.fullmatch(r"[a-z_]+", room.name)
        given = environment.LIBRARY / "given" / f"{room.given_on}.idp"
        assert room.given_on is None or given.is_file()
    assert set(rooms.LOADS) == {path.stem for path in (environment.LIBRARY / "given").glob("*.idp")}


def test_rooms_come_after_what_they_need():
    names = [room.name for room in rooms.rooms()]
    for room in rooms.rooms():
        for other in (*room.after, *room.brings,
                      *(name for needed in room.needs for name in needed)):
            assert names.index(other) < names.index(room.name)
    # patterns are summed in this order, on which the last bits of all results depend
    first = ["traction", "body_force", "thermal_strain", "point_load", "displacement"]
    loads = [room.name for room in rooms.rooms() if room.given_on]
    assert loads[: len(first)] == first


def test_vocabulary_has_every_macro_that_the_library_asks_for():
    """Macros that IFMACRO names are of the library itself, or documented for scenes."""
    text = "\n".join(path.read_text() for path in environment.LIBRARY.rglob("*.idp"))
    asked = set(re.findall(r"IFMACRO\(!?(\w+)\)", text))
    own = set(re.findall(r"^macro (\w+)", text, re.M))
    rooms_own = {f"{room.prefix}{word}" for room in rooms.rooms() for word in ("Room", "Asked")}
    given = {"libStudied", "libLoads", "libTimeLeftOut"}  # by the driver
    assert asked - own - rooms_own - given <= rooms.vocabulary()


@pytest.mark.parametrize("head, said", [
    ("// a.idp - title.\n//   a()                   text\n", "wrong number"),
    ("// a.idp - title.\n// declared by: a() 1\n// declares: b\n//\n"
     "//   a()                   text\n",
     "declares"),
    ("// a.idp - title.\n// declared by: a() 1\n//\n//   b()                   text\n",
     "does not say what a means")])
def test_a_head_of_another_form_is_refused(tmp_path, head, said):
    (tmp_path / "a.idp").write_text(head)
    with pytest.raises(ValueError, match=said):
        rooms.read_room(tmp_path / "a.idp")


def content(directory) -> tuple:
    """Records and manifest of an export; of static scenes factors at the end alone."""
    raw = read_manifest(directory).raw
    if "quasistatic" not in raw["rooms"]:
        raw["amplitudes"] = {name: values[-1] for name, values in raw["amplitudes"].items()}
    return (directory / "block-0.bin").read_bytes(), raw


@pytest.mark.parametrize("without, changes", [
    (("friction",), (("macro friction() F //\n", ""),)),
    (("contact",), (("macro friction() F //\n", ""), ("macro contact() 1 //\n", ""))),
    (("load2",), ((DRIVEN[0][1].split("\n")[1], ""),)),
    (("amplitude2",), (("amplitude2(t) t^2", "amplitude2(t) 1."),)),
    (("traction",), ((DRIVEN[0][1], ""),)),
    (("quasistatic",), (("quasistatic(1.);", ""),)),
    (("friction", "load1", "quasistatic"),
     (("macro friction() F //\n", ""), ("quasistatic(1.);", ""),
                                            (DRIVEN[0][1].split("\n")[0], "")))])
@pytest.mark.some(2)
def test_what_is_left_out_is_as_if_undeclared(tmp_path, variant, without, changes):
    """Records and manifest are those of the scene's text without the declarations, to the last bit.

    The amplitude of a load that is not there goes with it, as it would be refused; so does any
    without time, all of which end at 1.
    """
    whole = variant("driven", *DRIVEN)
    bare = variant("-".join(("less", *without)), *DRIVEN, *changes)
    text = bare.read_text()
    for k in (1, 2):
        if f"macro load{k}(" not in text or "quasistatic(" not in text:
            text = re.sub(rf"macro amplitude{k}.*\n", "", text)
    bare.write_text(text)
    freefem.export(whole, tmp_path / "left", {"cells": "2"}, without=without)
    freefem.export(bare, tmp_path / "bare", {"cells": "2"})
    assert content(tmp_path / "left") == content(tmp_path / "bare")


BOTH = (("macro friction() F //", "macro friction() (x < 5. ? F : 0.) //\n"
         "macro tresca() (x < 5. ? 0. : 3e7) //\nmacro wear() 1e-15 //\n"
         "macro cycles() 3 //\nmacro cycleStart() 0.5 //"),
        ('"monotone" ? t', '"monotone" ? sin(2*pi*t)'))


@pytest.mark.parametrize("without, lost", [
    (("tresca",), ["tresca"]),
    (("friction",), ["friction"]),
    (("friction", "tresca"), ["friction", "tresca", "wear", "cycles"])])
def test_what_needs_one_of_two_effects_stays_with_the_other_one(tmp_path, variant, without, lost):
    """Wear and cycles need friction or tresca, of which the scene has both."""
    freefem.export(variant("both", *BOTH), tmp_path, {"cells": "2"}, without=without)
    declared = {"contact", "friction", "tresca", "wear", "cycles", "traction", "quasistatic"}
    assert set(read_manifest(tmp_path).rooms) == declared - {*lost}


def test_what_needs_the_left_out_one_of_two_effects_goes_with_it(tmp_path, variant):
    """Of two effects that wear and cycles may need the scene has the one that is left out."""
    more = "macro friction() F //\nmacro wear() 1e-15 //\nmacro cycles() 3 //\n"
    scene = variant("one", (BOTH[0][0], more + "macro cycleStart() 0.5 //"), BOTH[1])
    freefem.export(scene, tmp_path, {"cells": "2"}, without=("friction",))
    assert set(read_manifest(tmp_path).rooms) == {"contact", "traction", "quasistatic"}


def test_contact_that_pairs_alone_brought_goes_with_them_and_what_needs_it(tmp_path, variant):
    """Wear needs friction, that contact, which the pairs of this scene have brought."""
    scene = variant("worn", ("macro contact() 1 //", "macro contactPair() 1, 3 //"),
                    ("macro friction() F //", "macro friction() F //\nmacro wear() 1e-15 //"))
    freefem.export(scene, tmp_path, {"cells": "2"}, without=("pair",))
    assert list(read_manifest(tmp_path).rooms) == ["traction", "quasistatic"]


def test_an_obstacle_that_is_left_out_has_no_shape_that_turns(tmp_path):
    with pytest.raises(InputError, match="obstacleAngle turns an obstacle whose shape is not kno"):
        freefem.export(freefem.find_scene("roller"), tmp_path, {}, without=("obstacle",))


def test_an_obstacle_that_is_left_out_leaves_a_surface_that_shifts(tmp_path):
    """Of indenter.edp, whose obstacle shifts alone."""
    freefem.export(freefem.find_scene("indenter"), tmp_path, {"steps": "2", "h": "2"},
                   without=("obstacle",))
    assert not any("phi" in name for name in read_manifest(tmp_path).columns)


@pytest.mark.parametrize("scene, without, said", [
    ("model", ("gap",), "gap is to be left out, but the scene does not declare it"),
    ("model", ("load2",), "load2 is to be left out, but"),
    ("model", ("amplitude2",), "amplitude2 is to be left out, but"),
    ("pressfit", ("quasistatic",), "quasistatic is to be left out, but"),
    ("model", ("frictoin",), "'frictoin' is no effect .*; did you mean friction"),
    ("model", ("load",), "'load' is no effect")])
def test_what_is_not_declared_cannot_be_left_out(tmp_path, scene, without, said):
    with pytest.raises(InputError, match=said) as found:
        freefem.export(freefem.find_scene(scene), tmp_path, {}, without=without)
    assert "\n" not in str(found.value)


def test_pairs_bring_contact(exported, tmp_path):
    assert list(read_manifest(exported("joint", h=3)).rooms)[:3] == ["contact", "friction", "pair"]
    freefem.export(freefem.find_scene("joint"), tmp_path, {"h": "3"}, without=("contact",))
    assert list(read_manifest(tmp_path).rooms) == ["probe", "traction", "quasistatic"]


def test_a_study_of_a_scene_without_an_effect(tmp_path):
    values = freefem.export_study(freefem.find_scene("bracket"), tmp_path, {}, "friction",
                                  ["0.1", "0.2"], without=("gap",))
    assert [value.columns for value in values] == [["friction"]] * 2


@pytest.mark.parametrize("changes, said", [
    ((("macro contact() 1 //\n", ""),),
     "friction is declared without contact: add  macro contact() label //"),
    ((("macro contact() 1 //", "macro contactNormal() [0., -1.] //"),),
     "contactNormal is declared without contact"),
    ((("macro friction() F //", "macro slipFactor(s) s //"),),
     "slipFactor is declared without friction: add  macro friction()"),
    ((("macro friction() F //",
       "macro slipFactor(s) s //\nmacro displacementFactor(s) s //\nmacro friction() F //"),
      ("real F", "real slipRange = 1.;\nreal F")),
     "slipFactor and displacementFactor are both declared"),
    ((("macro contact() 1 //",
       "macro contact() 1 //\nmacro gap() 1. //\nmacro obstacle(x, y) y //"),),
     "obstacle and gap are both declared"),
    ((("macro contact() 1 //",
       "macro contact() 1 //\nmacro contactNormal() [0., -1.] //\nmacro obstacle(x, y) y //"),),
     "obstacle and contactNormal are both declared"),
    ((("macro contact() 1 //\nmacro friction() F //\n", "macro initialX() 1. //\n"),),
     "initialX is declared without contact"),
    ((("macro contact() 1 //\nmacro friction() F //\n", "macro preload() 1 //\n"),),
     "preload is declared without contact"),
    ((("macro contact() 1 //\nmacro friction() F //\n", "macro bilateral() 1 //\n"),),
     "bilateral is declared without contact"),
    ((("macro contact() 1 //", "macro contactPair() 1, 3, 2 //"),), "contactPair expects pairs"),
    ((("macro contact() 1 //", "macro contact() 1 //\nmacro contactPair() 1, 3 //"),),
     "label 1 is declared for contact twice: name every boundary once (only in pairs with "
     "different ones may one be named again)"),
    ((("macro contact() 1 //", "macro contact() 1, 2, 1 //"),),
     "label 1 is declared for contact twice"),
    ((("macro contact() 1 //", "macro contactPair() 1, 3, 3, 1 //"),),
     "label 3 is declared for contact twice"),
    ((("macro contact() 1 //", "macro contactPair() 1, 3, 1, 3 //"),),
     "label 1 is declared for contact twice"),
    ((("macro contact() 1 //", "macro contact() 3 //\nmacro contactPair() 1, 3 //"),),
     "label 3 is in contact with an obstacle and the second one of a pair: give the parts"),
    ((("macro contact() 1 //", "macro contactPair() 1, 3 //\nmacro obstacle(x, y) y //"),),
     "obstacle is declared without contact to it: add  macro contact() label //"),
    ((("macro contact() 1 //", "macro contactPair() 1, 3 //\nmacro contactNormal() [0., 1.] //"),),
     "contactNormal is declared without contact to an obstacle")])
@pytest.mark.some(5)
def test_declarations_that_do_not_fit_together(tmp_path, variant, changes, said):
    scene = variant(f"unfit-{abs(hash(changes))}", *changes)
    with pytest.raises(InputError, match=re.escape(said)):
        freefem.export(scene, tmp_path, {"cells": "2"})


def test_numbers_go_up_to_nine(tmp_path, variant):
    scene = variant("nine",
                    ("macro amplitude1(t)",
                     "macro thermal9() 1e-4 //\nmacro amplitude9(t) t //\nmacro amplitude1(t)"))
    manifest = freefem.export(scene, tmp_path, {"cells": "2", "steps": "2"})
    assert manifest.amplitudes["9"] == [0, 0.5, 1]
    assert manifest.rooms["thermal_strain"] == {"numbers": [9]}
    with pytest.raises(InputError, match="thermal10: its number is one from 1 to 9"):
        freefem.export(variant("ten",
                               ("macro amplitude1(t)",
                                "macro thermal10() 1. //\nmacro amplitude1(t)")), tmp_path, {})


def test_a_new_room_needs_no_other_file(tmp_path, monkeypatch, variant):
    """A column at the contact nodes and a load, each by one include, in a copy of the library."""
    import shutil

    library = shutil.copytree(environment.LIBRARY, tmp_path / "lib")
    (library / "effects" / "stickiness.idp").write_text(
        "// stickiness.idp - a column.\n// declared by: sticky() c\n// needs: contact\n"
        "// column: stickiness >= 0\n//\n"
        "//   sticky()              c >= 0\nmacro stickinessColumn() (sticky) //\n")
    (library / "effects" / "wind.idp").write_text(
        "// wind.idp - a load on edges.\n// declared by: wind#() p\n// given on: edges\n//\n"
        "//   wind#()               pressure on the top\n"
        "macro windForm(k) pressure(3, wind#k) //\n")
    monkeypatch.setattr(environment, "LIBRARY", library)
    monkeypatch.setattr(rooms, "EFFECTS", library / "effects")
    for name, base in (("stickiness", "Effect"), ("wind", "LoadEffect")):
        (library / f"{name}.py").write_text(
            f"from driver.effects import {base}\n\n\nclass Room({base}):\n    pass\n")
    import driver.effects
    monkeypatch.setattr(driver.effects, "__path__", [*driver.effects.__path__, str(library)])
    from driver.scene import manifest
    monkeypatch.setattr(manifest, "EFFECTS", library / "effects")
    for cached in (rooms.rooms, rooms.vocabulary, rooms.studied):
        cached.cache_clear()
    try:
        scene = variant("new-rooms",
                        ("macro amplitude1(t)",
                         "macro sticky() x //\nmacro wind2() 1. //\nmacro amplitude1(t)"))
        from conftest import read_problem

        found = freefem.export(scene, tmp_path / "export", {"cells": "2"})
        problem = read_problem(tmp_path / "export", reduce=False)
    finally:
        for cached in (rooms.rooms, rooms.vocabulary, rooms.studied):
            cached.cache_clear()
    assert found.columns == ["friction", "stickiness"] and found.rooms["wind"] == {"numbers": [2]}
    boundary = problem.structure.contact
    assert boundary.columns["stickiness"] == pytest.approx(boundary.xy[:, 0], abs=1e-14)
    assert problem.subdomains[0].edge_loads.keys() == {0, 1}
    total = sum(sub.loads[1, 1::2].sum() for sub in problem.subdomains)
    assert total == pytest.approx(-2, rel=1e-13)  # pressure 1 on a side of length 2


def test_a_folder_that_freefem_cannot_name(tmp_path):
    with pytest.raises(InputError, match="semicolon"):
        freefem.export(freefem.find_scene("model"), tmp_path / "a;b", {})


def test_files_for_freefem_are_the_same_every_time(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        declarations.write(tmp_path / name)
    one, two = ({path.name: path.read_text() for path in (tmp_path / name / "rooms").iterdir()}
                for name in ("one", "two"))
    assert one == two and len(one) == 14
    assert seal.SHARED not in one
