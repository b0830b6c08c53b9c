"""What FreeFEM says when it fails, in one line of a user's words, with the line of the user's file.

FreeFEM names the place where it trips, which may be a macro of the library that the scene's own
words were put into. What it does not say is known from two files that the driver writes (see
declarations.py): every line of ``messages/contents.idp`` is about one macro of the scene, and a run
that is traced names each macro before it evaluates it (run_time.py).
"""

import re
from pathlib import Path

from .. import environment
from ..text import near
from . import declarations, grammar, numerals, rooms, run_time, script

COMPILE_ERROR = re.compile(r"Error line number\s*(\d+), in file\s+(macro: \w+ in )?(\S+?), "
                           r"before\s+token\s*(.*)")
REFUSED = "scene error: "  # before what the library refuses
MISTAKES = tuple((re.compile(start), words) for start, words in (
    ("syntax error", "syntax error"),
    (r"error operator\s+\(", "a call with arguments of a wrong number or kind"),
    (r"error operator\s+=", "a value of another kind than the variable's")))
WRONG_KIND = "values of the wrong kind"
TYPES = r"real|int|bool|string|complex|mesh|matrix|varf|border|fespace|func\s+\w+"
HINTS = {";": ": the content of a macro ends at its //, without a ;",  # by the token
         "on": ": terms are added: on(...) + on(...)",
         ",": ": terms are added: on(...) + on(...), traction(...) + pressure(...)",
         "=": ": the content of a macro follows its parentheses, without a ="}
HINTS |= {unit: ": numbers have no unit; units(...) names those of the scene" for unit in (
    "um", "mm", "cm", "m", "Pa", "kPa", "MPa", "GPa", "N", "kN")}


def library_words() -> list[tuple[str, str]]:
    """Macros of scene.idp that a scene calls: name, and the form that a user writes."""
    text = (environment.LIBRARY / "scene.idp").read_text()
    return [word for word in re.findall(r"^macro (\w+)(\([^)]+\))", text, re.MULTILINE)
            if word[0] in grammar.VOCABULARY]


def refusal(said: str, scene: Path) -> str:
    """What the library refuses, with the line of a label that the mesh lacks."""
    label = re.search(r"no boundary with label (-?\d+)", said)
    for source in grammar.sources(scene) if label else ():
        for macro in grammar.definitions(source):
            if macro.name in rooms.vocabulary() and re.search(rf"(?<![\w.]){label[1]}(?![\w.])",
                                                              macro.content):
                return f"{source.path.name} line {macro.line}: {macro.name}: {said}"
    first = re.match(r"\w*", said)[0]
    named = [first, *(name for room in rooms.rooms() if room.column == first
                      for name in room.declared_by)]
    for name in named:
        if name in rooms.vocabulary() and grammar.places(scene, rf"macro {name}\b"):
            return f"{grammar.place(scene, rf'macro {name}')}: {said}"
    if twice := re.match(r"the parameter ('\w+') is read twice", said):
        quoted = twice[1].replace("'", '"')
        return f"{grammar.place(scene, quoted, -1)}: {said}"
    if re.match(r"(rectangle|rotate|units|quasistatic|addBody|bodyMaterial|subdomains)\b", said):
        return f"{grammar.uses(scene, first, -1 if 'twice' in said else 0)}: {said}"
    if call := re.match(r'gmsh(?:Label|Region)\("[^"]*"\)', said):
        return f"{grammar.place(scene, re.escape(call[0]))}: {said}"
    if file := re.search(r"[\w./-]+\.(geo|msh)\b|^\S+(?= is (a dir|not there)| has no tri)", said):
        return grammar.place(scene, re.escape(file[0]) + '"') + f": {said}"
    found = placed(said, scene)
    return found if found != said else f"{scene.name}: {said}"


def _as_options(said: str, scene: Path) -> str:
    """FreeFEM's flags, -friction 0.3, as a user gives them to the driver, FRICTION=0.3."""
    if unknown := re.match(r"unknown parameter '-(\w+)'; this scene reads", said):
        name, names = unknown[1].upper(), re.findall(r" -(\w+)", said.upper())
        return f"unknown parameter {name}; this scene reads {', '.join(names)}{near(name, names)}"
    flags = "|".join(sorted(grammar.readable(scene), key=len, reverse=True))
    return re.sub(rf"(?<![\w-])-({flags})\b", lambda flag: flag[1].upper(), said)


def placed(reason: str, scene: Path) -> str:
    """What the solver refuses, with the line of the macro of the scene that it names first.

    It speaks of a contactPair as of a contact pair. What it says of an option has none, and what
    begins with a line of another run of the scene keeps that.
    """
    files = "|".join(re.escape(source.path.name) for source in grammar.sources(scene))
    if re.match(rf"[A-Z_]+\b|({files}) line \d+: ", reason):
        return reason
    named, fault = [], reason.split(": add ")[0]  # the rest is the remedy
    for source in grammar.sources(scene):
        for macro in grammar.definitions(source):
            words = re.findall("[A-Z]?[a-z]+", macro.name)
            forms = [f"[{word[0]}{word[0].lower()}]{word[1:]}" for word in words]
            said = re.search(r"\b" + r"\w*\s?".join(forms), fault)
            if said and macro.name in rooms.vocabulary():
                named.append((said.start(), -len(words), f"{source.path.name} line {macro.line}"))
    return f"{min(named)[2]}: {reason}" if named else reason


def failure(output: str, status: int, scene: Path, folder: Path, retrace) -> str:
    """One line out of FreeFEM's output.

    `folder` has the files that the driver wrote; `retrace()` runs the scene once more, traced, and
    returns the output.
    """
    if refused := re.search(rf"{REFUSED}(.*)", output):
        return refusal(_as_options(refused[1], scene), scene)
    taken = re.search(r"(?:The identifier )?(\w+) (?:exists\b|is not a Polymorphic id)", output)
    if taken and script.declared_by_library(taken[1]):
        return script.taken_name(scene, taken[1])
    if COMPILE_ERROR.search(output) or "Compile error" in output:
        return _compilation(output, scene, folder)
    return run_time.ended(output, status, scene, retrace)


def _compilation(output: str, scene: Path, folder: Path) -> str:
    """What FreeFEM does not understand."""
    if mistaken := re.search(r"Error in macro expansion (\w+)", output):
        return _wrong_call(mistaken[1], scene)
    if twice := re.search(r"ERREUR in macro name:(\w+)", output):
        if re.fullmatch(r"c[123]{2}", twice[1]) and grammar.places(scene, r"macro young\b"):
            return (f"{grammar.place(scene, rf'macro {twice[1]}')}: young and {twice[1]} are both "
                    "declared: a material is given by one or the other")
        last = grammar.place(scene, rf"macro {twice[1]}", -1)
        return f"{last}: the macro {twice[1]} is defined twice"
    error = COMPILE_ERROR.search(output)
    if unknown := re.search(r"The Identifier (\w+) does not exist", output):
        return _unknown(unknown[1], error, scene)
    if error and "lex: Error input opening file" in output:
        missing = error[4].strip()
        place = grammar.place(scene, re.escape(missing))
        return f"{place}: the included file {missing} is not there"
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    if not error:
        number = re.search(r"current line = (\d+)", output)
        said = next((line for line in lines if line.startswith("Compile error")), "no message")
        said = said.removeprefix("Compile error :").strip()
        if "macro usage" in said or "End of String" in output:
            said = "a parenthesis or a quote is not closed here or above"
        return f"FreeFEM failed in {scene.name} line {number[1] if number else 1}: {said}"
    return _misunderstood(error, lines, scene, folder)


def _misunderstood(error: re.Match, lines: list[str], scene: Path, folder: Path) -> str:
    """Syntax and types that are not what is expected."""
    number, macro, file, token = error.groups()
    path, token = Path(file), f" before token {error[4].strip()}" if error[4].strip() else ""
    if path == folder / declarations.MESSAGES / "contents.idp":
        name = declarations.content_of(path, int(number))
        return _wrong_content(name, scene)
    wrapper = macro and re.match(r"macro: (\w+)", macro)[1]
    if declared := _content_read(path, int(number), scene):
        return _wrong_content(declared, scene)
    remedy = _mixed(wrapper, scene, path.name, int(number)) or _by_name(scene, wrapper)
    content = " ".join(each.content for source in grammar.sources(scene)
                       for each in grammar.definitions(source) if each.name == wrapper)
    remedy = remedy or numerals.pointless(content, error[4].strip())
    if wrapper in rooms.vocabulary():
        remedy = remedy or _hint(error[4].strip(), content)
        return (f"{grammar.place(scene, rf'macro {wrapper}')}: FreeFEM does not understand "
                f"{wrapper}{token}{remedy}")
    if wrapper in dict(library_words()):
        if place := _after_unfinished(scene, wrapper):
            return f"{place} lacks its ;"
        return (f"{grammar.uses(scene, wrapper)}: FreeFEM does not understand what {wrapper} is "
                f"given{token}{remedy}")
    if name := _holding(error[4].strip(), path, scene):
        return (f"{grammar.place(scene, rf'macro {name}')}: FreeFEM does not understand "
                f"{name}{token}{remedy}")
    remedy = remedy or _of_line(_line(scene, path.name, int(number)), error[4].strip())
    if path.suffix not in (".edp", ".idp"):  # the end of the file
        path = scene
    said = next((words for start, words in MISTAKES if any(map(start.match, lines))), "")
    said = said or next((line for line in lines if " exists" in line), WRONG_KIND)
    if quoting := said == WRONG_KIND and _quoting(path, scene):
        return f"{quoting} is given a text in quotes where it takes a number"
    if said == "syntax error" and _declares(scene, path.name, int(number), error[4].strip()):
        said = f"'{error[4].strip()}' is a word of FreeFEM's own: choose another name"
    elif said == MISTAKES[1][1] and (form := _form(_line(scene, path.name, int(number)))):
        return f"{path.name} line {number}: {form}{remedy}"
    elif said == "syntax error" and (unfinished := _unfinished(scene, path.name, int(number))):
        said = f"syntax error; line {unfinished} may lack its ;"
    return f"FreeFEM failed in {path.name} line {number}{token}: {said}{remedy}"


def _hint(token: str, content: str) -> str:
    """What a token means that is not understood in the content of a macro; empty if unknown."""
    begins = token != "=" or content.lstrip().startswith("=")
    of_terms = token != "," or len(numerals.arguments(content)) > 1  # not inside a call
    return HINTS.get(token, "") if begins and of_terms else ""


def _of_line(code: str, token: str) -> str:
    """What to write instead of a word of a line of code that FreeFEM does not understand."""
    if token == "'":
        return '; texts stand in double quotes: "mm"'
    if share := re.search(r"(\d[\d.]*)\s*%(?=\s*[,;)])", code):
        return f"; write {share[1]} % as {float(share[1]) / 100:g}"
    if cut := re.search(r"\bsubdomains\s*\(\s*(\w+)\s*\)", code):
        return f'; it takes a text: subdomains("{cut[1]}")'
    return numerals.pointless(code, token)


def _by_name(scene: Path, *macros: str | None) -> str:
    """What to write instead of "foot" in macros of the scene, or in any that calls traction or
    pressure; empty where they have no text in quotes.
    """
    contents = [each.content for source in grammar.sources(scene)
                for each in grammar.definitions(source) if each.name in macros
                or {"traction", "pressure"} & {*macros} & {*re.findall(r"\w+", each.content)}]
    text = re.search(r'"(([A-Za-z]\w*)[^"]*)"', " ".join(contents))
    return (f"; a label is a number: that of a curve with this name in a gmsh file is given by  "
            f'int {text[2]} = gmshLabel("{text[1]}");  after gmshBody') if text else ""


def _holding(token: str, path: Path, scene: Path) -> str:
    """The first macro of the scene with the token at which FreeFEM trips over a line of the
    library's, which the macro's content was put into; "" for none.
    """
    files = grammar.sources(scene)
    if not token or path.suffix != ".idp" or any(file.path.name == path.name for file in files):
        return ""
    word = rf"(?<!\w){re.escape(token)}(?!\w)"
    return next((macro.name for file in files for macro in grammar.definitions(file)
                 if macro.name in rooms.vocabulary() and re.search(word, macro.content)), "")


def _quoting(path: Path, scene: Path) -> str:
    """The first macro of the scene with a text in quotes, and its place, where FreeFEM trips over a
    line of the library's; "" for none.
    """
    files = grammar.sources(scene)
    if any(file.path.name == path.name for file in files):
        return ""
    return next((f"{file.path.name} line {macro.line}: {macro.name}" for file in files
                 for macro in grammar.definitions(file)
                 if macro.name in rooms.vocabulary() and '"' in macro.content), "")


def _form(code: str) -> str:
    """What is wrong with the call of the library's that a line makes; "" if it makes none."""
    for call in re.finditer(r"\b(\w+)\s*\(", code):
        name = call[1]
        for file in ("scene.idp", "gmsh.idp"):
            for form, meaning in rooms.listed_calls(environment.LIBRARY / file):
                if re.search(rf"\b{name}\(", form):
                    return (f"{name} is called with arguments of a wrong number or kind: {form}  "
                            f"{meaning}{numerals.too_many(code[call.end():], form)}")
    return ""


def _content_read(path: Path, number: int, scene: Path) -> str:
    """The macro of the scene whose content a line of the library's takes as it is; "" for none."""
    if any(source.path.name == path.name for source in grammar.sources(scene)):
        return ""
    for library in environment.LIBRARY.rglob(path.name):
        line = "".join(library.read_text().splitlines()[number - 1 : number]).split("//")[0]
        taken = re.search(r"= \[?(\w+)\]?;", line)
        known = taken and taken[1] in rooms.vocabulary()
        if known and grammar.places(scene, rf"macro {taken[1]}\b"):
            return taken[1]
    return ""


def _line(scene: Path, name: str, number: int) -> str:
    """Code of a line of a file of the scene; empty if there is none."""
    return next((source.code[number - 1] for source in grammar.sources(scene)
                 if source.path.name == name and 0 < number <= len(source.lines)), "")


def _declares(scene: Path, name: str, number: int, word: str) -> bool:
    """Whether a line of a file is about to give a variable, a border or a function this name."""
    return bool(re.search(rf"\b(?:{TYPES})(?:\s*\[[^\]]*\])?\s+{re.escape(word)}\b",
                          _line(scene, name, number)))


def _mixed(macro: str | None, scene: Path, name: str, number: int) -> str:
    """What to write instead of min(1, t), in a macro of the scene or in a line of a file.

    FreeFEM has min and max for two whole numbers and for two reals; empty where neither is called
    with a whole number beside something else.
    """
    contents = [each.content for source in grammar.sources(scene)
                for each in grammar.definitions(source) if each.name == macro]
    for code in contents or [_line(scene, name, number)]:
        for call in re.finditer(r"\b(min|max)\s*\(", code):
            parts = numerals.arguments(code[call.end():])
            whole = [re.fullmatch(r"-?\d+", part) is not None for part in parts]
            if len(parts) == 2 and whole[0] != whole[1]:
                written = ", ".join(f"{part}." if of else part for part, of in zip(parts, whole))
                return f"; {call[1]} takes two reals: write {call[1]}({written})"
    return ""


def _unfinished(scene: Path, name: str, number: int) -> int:
    """The last line before a line of a file, macros left out, if it does not end; else 0."""
    source = next((source for source in grammar.sources(scene) if source.path.name == name), None)
    if source is None:
        return 0
    within = set()
    for macro in grammar.definitions(source):
        within |= set(range(macro.line, macro.line + 1 + macro.content.count("\n")))
    lines = source.code
    for at in range(number - 1, 0, -1):
        code = lines[at - 1].strip()
        if code and at not in within and not re.match(r"(END)?IFMACRO|include|load", code):
            return 0 if code.endswith((";", "}", "{", ",")) or "addBody" in code else at
    return 0


def _after_unfinished(scene: Path, name: str) -> str:
    """The line of code before one that begins with `name`, if it is no macro and does not end."""
    for source in grammar.sources(scene):
        for number, line in enumerate(source.lines, 1):
            if re.match(rf"\s*{name}\b", line):
                if at := _unfinished(scene, source.path.name, number):
                    return f"{source.path.name} line {at}"
    return ""


def _unknown(name: str, error: re.Match | None, scene: Path) -> str:
    """A name that means nothing: a typing error, or an include that is missing."""
    hint = ""
    if name in ("gmshBody", "gmshNumber", "gmshLabel", "gmshRegion"):
        hint = '; it needs  include "gmsh.idp"  after scene.idp'
    elif name == "t":
        hint = "; the time is the argument of an amplitude: macro amplitude1(t) ... //"
    elif re.fullmatch("u|v|u_?[xyrz]|v_?[xyrz]", name):
        hint = "; displacements are u1, u2, along x, y or r, z, with test functions v1, v2"
    elif name in ("young", "poisson", "c11", "c12", "c13", "c22", "c23", "c33"):
        return (f"{scene.name}: the scene declares no {name}: a material is given by young and "
                "poisson or, in plane bodies, by all of c11, c12, c13, c22, c23, c33")
    elif grammar.places(scene, rf"\b(physical|choice|whole)\s*\(\s*{name}\b"):
        hint = "; is it a name that belongs in quotes?"
    elif name in ("yes", "no", "off") and (macro := _whole_content(name, scene)):
        return _wrong_content(macro, scene)
    elif name in rooms.vocabulary():
        macro = next(macro for macro in rooms.all_macros() if name in macro.names)
        return f"{scene.name}: the scene must give {name}: {macro.text}"
    elif not grammar.uses(scene, name, default=""):
        where = f"{Path(error[3]).name} line {error[1]}" if error else scene.name
        return f"FreeFEM failed in {where}: the name '{name}' is not declared"
    else:
        hint = script.hint(name, [word for word, _ in library_words()])
        if hint.endswith(f" {name}?"):
            hint = "; is it a name that belongs in quotes?"
    return f"{grammar.uses(scene, name)}: the name '{name}' is not declared{hint}"


def _whole_content(name: str, scene: Path) -> str:
    """A macro of the vocabulary that contains nothing but `name`; empty if there is none."""
    return next((each.name for source in grammar.sources(scene)
                 for each in grammar.definitions(source)
                 if each.content.strip() == name and each.name in rooms.vocabulary()), "")


def _wrong_call(name: str, scene: Path) -> str:
    """A macro that is called with another number of arguments than it has."""
    form = dict(library_words()).get(name)
    place = grammar.uses(scene, name)
    said = f"{place}: {name} is called with a wrong number of arguments"
    if not form:
        return said
    remedies = [numerals.too_many(each.content[call.end():], form)
                for source in grammar.sources(scene) for each in grammar.definitions(source)
                for call in re.finditer(rf"\b{name}\s*\(", each.content)]
    return f"{said}: it is {name}{form}{next(filter(None, remedies), '')}"


def _wrong_content(name: str, scene: Path) -> str:
    """A macro whose content is of another kind than the library takes."""
    macro = next(macro for macro in rooms.all_macros() if name in macro.names)
    given = next((" ".join(each.content.split()) for source in grammar.sources(scene)
                  for each in grammar.definitions(source) if each.name == name), "")
    return (f"{grammar.place(scene, rf'macro {name}')}: the macro {name} cannot be  {given}: it "
            f"expects {macro.text}{_by_name(scene, name) if 'label' in macro.text else ''}")
