"""One version, in all places that name it, and recipes whose files exist."""

import re

import numpy as np
from petsc4py import PETSc

from driver import environment, options

ROOT = environment.ROOT


def test_one_version_everywhere(solved):
    """pyproject.toml, help, summary.json, the citation and the list of changes."""
    version = environment.version()
    assert re.fullmatch(r"\d+\.\d+\.\d+", version)
    assert options.usage().splitlines()[0] == f"contact suite {version}"
    versions = solved("patch").summary["versions"]
    assert versions["suite"] == version and versions["numpy"] == np.__version__
    assert versions["petsc"] == ".".join(map(str, PETSc.Sys.getVersion()))
    citation = (ROOT / "driver" / "CITATION.cff").read_text()
    assert f"\nversion: {version}\n" in citation
    assert re.search(rf"^## {re.escape(version)}\b", (ROOT / "driver/CHANGES.md").read_text(),
                     re.MULTILINE)


def test_recipes_name_what_exists():
    recipe = (ROOT / "driver" / "Containerfile").read_text()
    for line in re.findall(r"^COPY (.+) \S+$", recipe, re.MULTILINE):
        assert all((ROOT / name).exists() for name in line.split())
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    assert "bash .ci/run" in workflow and (ROOT / ".ci" / "run").exists()
    for text in (recipe, workflow):
        targets = re.findall(r"(?:RUN|run:|suite) make (\w+)", text)
        makefile = (ROOT / "Makefile").read_text()
        assert targets and all(re.search(rf"^{name}:", makefile, re.MULTILINE) for name in targets)
