"""What a scene may declare, room by room, for FreeFEM: ``rooms/*.idp`` of an export directory.

FreeFEM knows whether a macro is defined (IFMACRO) but cannot list files or count macros: what
follows from the list of rooms (rooms.py) is written before it starts. Of every room, guarded by the
macros that declare it, there are

- ``switches``: what is left out is checked to be there; ``<room>Asked`` of what is not,
- ``include``: the room itself, what its loads are given on, and what it lacks,
- ``kinematics``: the same of rooms that come before the forms of elasticity,
- ``hold``: what these fix of a subdomain besides its supports, ``<room>Hold``,
- ``patterns``: its load patterns, one for each number, in variables ``<room>Pattern<number>``,
- ``assemble``, ``fix``, ``record``: what these add to a subdomain's loads, supports and record (see
  loads.idp),
- ``columns``, ``evaluate``, ``column-names``: its numbers at the contact nodes (see contact.idp),
- ``fields``: its numbers at all nodes, ``<room>Fields``,
- ``manifest``: its entry in the manifest, ``<room>Manifest``,
- ``amplitudes``: the histories.

Besides, ``messages/*.idp`` (see explain.py): ``contents``, which has every macro of the scene stand
once where its kind is expected, on a line of its own, and ``trace``, the macro evaluating(name),
which says what follows in a run that is traced.
"""

from pathlib import Path

from ..errors import InputError
from ..text import near
from .rooms import NUMBERS, Room, all_macros, camel, rooms, source

FOLDER, MESSAGES = "rooms", "messages"
EVALUATING = "evaluating: "  # said in a traced run before a macro of the scene is evaluated
# what a macro of a kind is put into; nothing of it is executed
KINDS = {"number": "{{ real libValue = {0}; }}", "labels": "{{ int[int] libValue = [{0}]; }}",
         "form": "{{ varf libValue([u1, u2], [v1, v2]) = {0}; }}",
         "vector": "{{ real libValue = ({0})'*[1., 1.]; }}",
         "list": "{{ real[int] libValue = {0}; }}"}
GIVEN_ON = {"edges": "form", "supports": "form", "triangles": "vector", "initial_stress": "number",
            "nodes": "list"}
CONTENTS = {"support": "form", "contact": "labels", "contactPair": "labels",
            "contactNormal": "vector", "young": "number", "poisson": "number", "piece": "number",
            "stepTimes": "list", "tie": "labels", "curved": "labels", "periodic": "labels",
            "foundation": "labels",
            "foundationNormal": "number", "foundationTangential": "number", "pointSpring": "list",
            "normalComplianceExponent": "number", "largeSliding": "number",
            "slipFactor": "number", "obstacleX": "number", "obstacleY": "number",
            "obstacleAngle": "number", "obstaclePivot": "vector", "gapInTime": "number",
            "obstacleInTime": "number", "displacementFactor": "number", "amplitude#": "number",
            **{f"c{k}": "number" for k in (11, 12, 13, 22, 23, 33)}}
QUASISTATIC = "quasistatic"  # what a scene declares by calling quasistatic(T)


def without_names(without: tuple[str, ...]) -> set[str]:
    """What is left out, with all that needs it; numbered macros as load2.

    What needs one of several rooms, of which some are left in, is not among them: whether the scene
    declares one of these is known when FreeFEM reads it.

    Names are those of rooms (``friction``), of one of several loads (``load2``), ``quasistatic``
    (one static step at the end time) and ``amplitude2`` (the loads keep the factor of the end
    time). Raises InputError for any other.
    """
    effects = [room.name for room in rooms()]
    known = {*effects, QUASISTATIC, *(f"amplitude{k}" for k in NUMBERS)}
    for room in rooms():
        if room.numbered:
            known.update(name for macro in room.macros for name in macro.names)
    for name in without:
        if name not in known:
            raise InputError(f"'{name}' is no effect that can be left out; effects are "
                             f"{', '.join(effects)}, {QUASISTATIC}, and load1, amplitude1, ..."
                             f"{near(name, known)}")
    absent = set(without)
    for room in rooms():  # in which what is needed comes first
        if any(absent.issuperset(names) for names in room.needs) or absent & {*room.brings}:
            absent.add(room.name)
    return absent


def _perhaps_without(absent: set[str]) -> set[str]:
    """What is left out, and what may lack something then: as contact that only pairs brought.

    Whether it does is known when FreeFEM reads the scene.
    """
    perhaps = {*absent, *(name for room in rooms() if room.name in absent for name in room.brings)}
    for room in rooms():  # in which what is needed comes first
        if any(perhaps.intersection(names) for names in room.needs):
            perhaps.add(room.name)
    return perhaps


def write(directory: Path, without: tuple[str, ...] = (), traced: bool = False) -> None:
    """Write the files for a scene of which `without` is left out; `traced`: to explain a failure.

    Raises InputError as `without_names`.
    """
    absent = without_names(without)
    used = [room for room in rooms() if room.name not in absent]
    loads = [_Load(room, k) for room in used if room.given_on for k in NUMBERS
             if _numbered(room, k) not in absent]
    columns = [room for room in used if room.column or room.columns]
    files = {
        "switches": [*_switches(without),
                     *(line for room in used for line in _asked(room, absent))],
        "kinematics": [line for room in used if room.before for line in _include(room, absent)],
        "include": [line for room in used if not room.before for line in _include(room, absent)],
        "patterns": [*(line for load in loads for line in load.declaration()), *_idle(absent)],
        "assemble": [line for load in loads for line in load.call("Assemble")],
        "fix": [line for load in loads for line in load.call("Fix")],
        "hold": [line for room in used if room.before
                 for line in _if(f"{room.prefix}Hold", f"{room.prefix}Hold")],
        "record": [line for load in loads for line in load.call("Record")],
        "columns": [line for room in columns for line in _column(room)],
        "evaluate": [line for room in columns for line in _evaluate(room)],
        "column-names": [line for room in columns for line in _column_name(room)],
        "fields": [line for room in used
                   for line in _if(f"{room.prefix}Fields", f"{room.prefix}Fields")],
        "manifest": [line for room in used for line in _manifest(room)],
        "amplitudes": [line for k in NUMBERS for line in _amplitude(k, absent)],
    }
    messages = {
        "contents": [line for name, kind in _kinds().items() for line in _content(*name, kind)],
        "trace": [f'macro evaluating(name) cerr << "{EVALUATING}" << name << endl; //' if traced
                  else "macro evaluating(name) //"],
    }
    for folder, contents in ((FOLDER, files), (MESSAGES, messages)):
        (directory / folder).mkdir(exist_ok=True)
        for name, lines in contents.items():
            text = "".join(f"{line}\n" for line in lines)
            (directory / folder / f"{name}.idp").write_text(text)


def _kinds() -> dict[tuple[str, str], str]:
    """What macros expect, by name and arguments."""
    kinds = {}
    for room in rooms():
        as_it_stands = f"macro {room.prefix}Form(k) {{0}}k //"
        for name in room.declared_by:
            if room.given_on and as_it_stands.format(name) in source(room):
                kinds[name] = GIVEN_ON[room.given_on]
            elif room.column and f"IFMACRO({name}," not in source(room):
                # the room takes no word, such as yes, besides numbers
                kinds[name] = "number"
    kinds |= CONTENTS
    return {(name, macro.arguments): kinds[macro.name] for macro in all_macros()
            if macro.name in kinds for name in macro.names}


def _content(name: str, arguments: str, kind: str) -> list[str]:
    """A macro where its kind is expected, in a function that nothing calls."""
    call = f"{name}({', '.join('0.5' for _ in arguments.split(','))})" if arguments else name
    # not nested in a second IFMACRO, within which FreeFEM counts lines otherwise
    return _if(name, f"func int libContent{name}() {KINDS[kind].format(call)}")


def content_of(path: Path, line: int) -> str:
    """The macro that a line of ``contents.idp`` is about."""
    return path.read_text().splitlines()[line - 1].split("libContent")[1].split("(")[0]


def _if(macro: str, *lines: str) -> list[str]:
    """The lines where `macro` is defined or, as in !friction, is not."""
    return [f"IFMACRO({macro})", *lines, "ENDIFMACRO"]


def _unless_any(macros: list[str], *lines: str) -> list[str]:
    """The lines where none of the macros is defined."""
    for macro in reversed(macros):
        lines = _if(f"!{macro}", *lines)
    return list(lines)


def _room(room: Room) -> str:
    """The macro that is defined where the room is included."""
    return f"{room.prefix}Room"


def _numbered(room: Room, k: int) -> str:
    """The macro that declares load k of a room."""
    return next(iter(room.declared_by)).replace("#", str(k))


def _declaring(room: Room) -> list[str]:
    """The macros that declare a room, each number of them."""
    return [name for macro in room.macros if macro.name in room.declared_by for name in macro.names]


def _asking(room: Room, absent: set[str]) -> list[str]:
    """The macros that declare a room or one that brings it, without what is left out."""
    bringing = [other for other in rooms()
                if room.name in other.brings and other.name not in absent]
    return [name for other in (room, *bringing) for name in _declaring(other)
            if name not in absent]


def _switches(without: tuple[str, ...]) -> list[str]:
    """Refusal of what is left out but not declared."""
    lines = []
    for name in without:
        reason = f'refuse("{name} is to be left out, but the scene does not declare it");'
        room = next((room for room in rooms() if room.name == name), None)
        if name == QUASISTATIC:
            lines += [f"if (!isQuasistatic) {reason}", "isQuasistatic = false;",
                      "macro libTimeLeftOut() 1 //"]
        elif room:
            lines += _unless_any(_asking(room, set()), reason)
        else:
            lines += _unless_any([name], reason)
    return lines


def _asked(room: Room, absent: set[str]) -> list[str]:
    """<room>Asked, defined where the scene asks for the room by a macro that is not left out.

    Rooms that come before this one know by it what the scene has.
    """
    asked = f"{room.prefix}Asked"
    return [line for macro in _asking(room, absent)
            for line in _if(f"!{asked}", *_if(macro, f"macro {asked}() 1 //"))]


def _include(room: Room, absent: set[str]) -> list[str]:
    """The room, where one of its macros, or of those of rooms that bring it, is defined.

    <room>Lacks is defined where something is missing, which is refused or, if it may have been left
    out, leaves the room out too, and <room>Room where it is included.
    """
    lacks = f"{room.prefix}Lacks"
    body = [f"macro {_room(room)}() 1 //"]
    if room.given_on:
        given = f"{camel(room.given_on)}Given"
        body += _if(f"!{given}", f"macro {given}() 1 //",
                    f'include "given/{room.given_on}.idp"')
    perhaps = _perhaps_without(absent)
    missing = [line for needed in room.needs for line in _lacks(room, needed, lacks, perhaps)]
    lines = _if(f"{room.prefix}Asked", *missing,
                *_if(f"!{lacks}", *body, f'include "effects/{room.name}.idp"'))
    for macro in room.macros:
        if macro.name not in room.declared_by and macro.arguments is not None:
            lines += _if(macro.name, *_if(f"!{lacks}", *_if(f"!{_room(room)}",
                                                            _refusal(macro.name, room))))
    return lines


def _lacks(room: Room, needed: tuple[str, ...], lacks: str, absent: set[str]) -> list[str]:
    """The macro `lacks` where none of `needed` is included.

    If nothing of these may be left out (`absent`), the room is refused there, by the macro that
    declares it.
    """
    others = [other for other in rooms() if other.name in needed]
    lines = _if(f"!{lacks}", f"macro {lacks}() 1 //")
    for macro in _declaring(room) if absent.isdisjoint(needed) else ():
        lines += _if(macro, _refusal(macro, others[0]))
    return _unless_any([_room(other) for other in others], *lines)


def _refusal(macro: str, room: Room) -> str:
    """Refusal of a scene that declares `macro` without a room."""
    example = room.example.replace('"', '\\"')
    name = room.name.replace("_", " ")
    return f'refuse("{macro} is declared without {name}: add  {example}");'


def _column(room: Room) -> list[str]:
    """The number of a room's first column, where the room is included."""
    line = f"int {room.prefix}At = contactColumns"
    more = f" contactColumns += {room.prefix}Columns;"
    return _if(_room(room), f"{line};{more}" if room.columns else f"{line}++;")


def _column_name(room: Room) -> list[str]:
    """The names of a room's columns for the manifest."""
    if room.columns:
        return _if(_room(room), f"{room.prefix}Names({room.prefix}At)")
    return _if(_room(room),
               f'libJson << ({room.prefix}At > 0 ? ", " : "") << "\\"{room.column}\\"";')


def _evaluate(room: Room) -> list[str]:
    """The numbers of a room's columns."""
    column = f"{room.prefix}At"
    if room.columns:
        return _if(_room(room), f"{room.prefix}Evaluate({column})")
    own, common = f"{room.prefix}Evaluate", f"evaluateColumn({room.prefix}Column, {column})"
    declaring = [line for macro in _declaring(room)
                 for line in _if(macro, f'evaluating("{macro}")')]
    lines = [*declaring, *_if(own, f"{own}({column})"), *_if(f"!{own}", common),
             f'refuseInfinite("{_declaring(room)[0]}", {column})']
    if room.nonnegative:
        lines.append(f'refuseNegative("{_declaring(room)[0]}", {column})')
    return _if(_room(room), *lines)


def _amplitude(number: int, absent: set[str]) -> list[str]:
    """The history of the loads with a number; that of a left-out one rests at the end time."""
    name = f"amplitude{number}"
    time = "timeEnd" if name in absent else "(timeEnd*libAt/(libHistory.n - 1))"
    return _if(name, f"if (libNumber == {number}) {{", f'evaluating("{name}")',
               "for (int libAt = 0; libAt < libHistory.n; ++libAt)",
               f"libHistory[libAt] = {name}({time}); }}")


def _idle(absent: set[str]) -> list[str]:
    """Refusal of amplitudes without a load or without time, unless that is left out."""
    left_out = {name[-1] for name in absent} | ({*map(str, NUMBERS)} if absent & _all_loads() else
                                                set())
    histories = [k for k in NUMBERS if f"amplitude{k}" not in absent]
    timeless = [] if QUASISTATIC in absent else histories
    idle = [k for k in NUMBERS if str(k) not in left_out]
    return [line for check, numbers in (("refuseTimeless", timeless), ("refuseIdle", idle))
            for k in numbers for line in _if(f"amplitude{k}", f"{check}({k});")]


def _all_loads() -> set[str]:
    """Names of the rooms that give loads."""
    return {room.name for room in rooms() if room.given_on}


def _manifest(room: Room) -> list[str]:
    """The entry of a room in the manifest."""
    lines = [f'libJson << libComma << endl << "  \\"{room.name}\\": {{"; libComma = ",";']
    if room.numbered:
        lines.append(f'writeNumbers("{room.name}")')
    lines += _if(f"{room.prefix}Manifest", f"{room.prefix}Manifest")
    return _if(_room(room), *lines, 'libJson << "}";')


class _Load:
    """Load k of a room, which is a load pattern where its macro is defined."""

    def __init__(self, room: Room, k: int):
        self.macro, self.given_on = _numbered(room, k), camel(room.given_on)
        self.form, self.pattern = f"{room.prefix}Form({k})", f"{room.prefix}Pattern{k}"
        words = f'"{room.name}", "{room.given_on}", {k}, "{self.macro}"'
        self.declared = f"int {self.pattern} = declare({words});"

    def declaration(self) -> list[str]:
        """Its pattern, and what is to be prepared once."""
        prepare = f"{self.given_on}Prepare"
        call = f'{prepare}({self.form}, {self.pattern}, "{self.macro}")'
        return _if(self.macro, self.declared, *_if(prepare, call))

    def call(self, what: str) -> list[str]:
        """The macro `what` of what it is given on, if there is one."""
        name = f"{self.given_on}{what}"
        call = f"{name}({self.form}, {self.pattern})"
        return _if(self.macro, *_if(name, f'evaluating("{self.macro}")', call))
