"""Pieces of a page: text, tables, pictures and verdict as HTML that needs no other file."""

import base64
import struct
from html import escape
from pathlib import Path

from ..errors import InputError
from ..files import renamed

FILE = "report.html"
WIDE = 2.5  # width of a picture over its height from which on a phone would show it too small
NARROW = 900  # pixels of a picture that a phone can show as it is
LONG = 24  # characters of a cell that is not to be broken at every word
COLOURS = {"good": "#009E73", "doubtful": "#E69F00", "bad": "#D55E00"}  # of verdicts
STYLE = """
body { font: 16px/1.45 system-ui, sans-serif; color: #222; margin: 0 auto; padding: 0 1rem 3rem;
       max-width: 60rem; overflow-wrap: break-word; }
h1 { font-size: 1.5rem; margin: 1.2rem 0 .4rem; } h2 { font-size: 1.15rem; margin: 1.6rem 0 .5rem; }
.verdict { border-left: .45rem solid; background: #f6f6f4; padding: .6rem .9rem; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: .9rem; }
th, td { padding: .25rem .7rem .25rem 0; text-align: left; vertical-align: top;
         border-bottom: 1px solid #e4e4e0; }
th { font-weight: 600; } .number { text-align: right; font-variant-numeric: tabular-nums;
         white-space: nowrap; }
.long { min-width: 14rem; }
figure { margin: 0 0 1.4rem; } img { max-width: 100%; height: auto; display: block; }
.wide { overflow-x: auto; } .wide img { max-width: none; width: max(100%, 44rem); }
figcaption { color: #666; font-size: .9rem; } summary { cursor: pointer; margin: .4rem 0; }
pre { overflow-x: auto; font-size: .8rem; } li { margin: .2rem 0; }
"""


HEAD = ('<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n')
OWN = f"<style>{STYLE[:44]}"  # by which a page of ours is known, with its head


def write(directory: Path, title: str, parts: list[str]) -> Path:
    """Write the page of some parts in `directory`; returns its path.

    Raises InputError where a file of that name is there that is no page of ours.
    """
    path = directory / FILE
    if not is_ours(path):
        raise InputError(f"{path} is no page of make report and stays as it is: move it away, or "
                         "give it another name")
    with renamed(path) as hidden:
        hidden.write_text(page(title, parts), encoding="utf-8")
    return path


def is_ours(path: Path) -> bool:
    """Whether nothing is at `path`, or a page that `page` made."""
    if not path.exists():
        return not path.is_symlink()
    if path.is_symlink() or not path.is_file():
        return False
    text = path.read_text(encoding="utf-8", errors="replace")
    return text.startswith(HEAD) and OWN in text


def page(title: str, parts: list[str]) -> str:
    """The page of some parts; empty ones are left out."""
    return (f"{HEAD}<title>{escape(title)}</title>\n<style>{STYLE}</style></head>\n<body>\n"
            f"<h1>{escape(title)}</h1>\n" + "\n".join(filter(None, parts)) + "\n</body></html>\n")


def section(title: str, *parts: str) -> str:
    """A heading and what belongs to it; nothing where that is empty."""
    content = "\n".join(filter(None, parts))
    return f"<h2>{escape(title)}</h2>\n{content}" if content else ""


def verdict(text: str, kind: str) -> str:
    """What to think of the results; `kind` is one of COLOURS."""
    return f'<p class="verdict" style="border-color: {COLOURS[kind]}">{escape(text)}</p>'


def paragraph(text: str) -> str:
    """A paragraph."""
    return f"<p>{escape(text)}</p>" if text else ""


def bullets(items) -> str:
    """A list."""
    lines = "".join(f"<li>{escape(str(item))}</li>" for item in items)
    return f"<ul>{lines}</ul>" if lines else ""


def table(head: list[str], rows: list[list]) -> str:
    """A table; numbers have four digits and stand flush right. Nothing without rows."""
    if not rows:
        return ""
    lines = ["".join(f"<th>{escape(str(cell))}</th>" for cell in head)]
    lines += ["".join(_cell(cell) for cell in row) for row in rows]
    body = "".join(f"<tr>{line}</tr>\n" for line in lines)
    return f'<div class="scroll"><table>{body}</table></div>'


def folded(title: str, content: str) -> str:
    """What is shown when its title is clicked."""
    if not content:
        return ""
    return f"<details><summary>{escape(title)}</summary>{content}</details>"


def picture(path: Path, caption: str, wide: float = WIDE) -> str:
    """A PNG or GIF file inside the page; a `wide` one is scrolled on a narrow screen."""
    kind, content = path.suffix.removeprefix("."), path.read_bytes()
    image = (f'<img alt="{escape(caption)}" src="data:image/{kind};base64,'
             f'{base64.b64encode(content).decode()}">')
    if kind == "png":
        width, height = struct.unpack(">II", content[16:24])
        if width > wide * height and width > NARROW:
            image = f'<div class="wide">{image}</div>'
    return f"<figure>{image}<figcaption>{escape(caption)}</figcaption></figure>"


def plain(value) -> str:
    """A value as people read it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(map(plain, value))
    return "" if value is None else str(value)


def _cell(value) -> str:
    kind = "long" if len(plain(value)) > LONG else ""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        kind = "number"
    return f"<td{kind and f' class={kind}'}>{escape(plain(value))}</td>"
