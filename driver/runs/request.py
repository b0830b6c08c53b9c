"""What the front asks of the ranks, as a file where there are several of them."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

NAME = "request.json"


@dataclass(frozen=True)
class Request:
    """A run, a search for settings or a study, whose export the working directory holds."""

    scene: str  # its name
    script: str  # path of the scene
    parameters: dict[str, str]  # of the scene
    settings: dict[str, float | int | str]  # of options.Settings, only those that were given
    without: tuple[str, ...] = ()  # effects of the scene that are treated as undeclared
    quiet: bool = False  # no progress on the screen
    fields: bool = True  # write the fields for ParaView
    figures: bool = False  # there will be figures, which may be drawn while errors are estimated
    errors: str = "yes"  # estimates of all errors, "energy": that of the energy norm alone, or "no"
    accuracy: tuple[float, str] | None = None  # relative error to reach, and the quantity
    quantity: str = ""  # whose price the run ends with; by default the first
    refined: tuple[str, ...] = ()  # directories of the refinement cycles before this run
    refine: bool = False  # this is such a cycle: leave the element sizes of the next mesh
    study: str = ""  # parameter of a study ...
    values: tuple[str, ...] = ()  # ... and its values
    fingerprint: dict[str, str] = field(default_factory=dict)  # see march.checkpoint
    seconds: dict[str, float] = field(default_factory=dict)  # of the stages before

    @classmethod
    def of(cls, run, **parts) -> "Request":
        """The request of `run` (a runs.run.Run); `parts` are further entries, or other ones."""
        entries = {"scene": run.scene.stem, "script": str(run.scene), "parameters": run.parameters,
                   "settings": run.settings, "without": run.without, "quiet": run.quiet,
                   "fields": run.fields, "figures": run.figures, "errors": run.errors,
                   "accuracy": run.accuracy, "quantity": run.quantity}
        return cls(**entries | parts)

    def write(self, directory: Path) -> None:
        """Leave the request in `directory`."""
        (directory / NAME).write_text(json.dumps(asdict(self)))

    @classmethod
    def read(cls, directory: Path) -> "Request":
        """The request in `directory`."""
        entries = json.loads((directory / NAME).read_text())
        for name in ("without", "accuracy", "refined", "values"):  # JSON knows lists only
            if entries[name] is not None:
                entries[name] = tuple(entries[name])
        return cls(**entries)
