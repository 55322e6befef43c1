"""Small valid calls of every verb, with the files that they read and write.

Left out: `view` and `stream` with a live page, which serve until somebody stops them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import yaml

import patagium as pt
from patagium.learning import load_identification, load_model, load_settings
from patagium_lab.attack import seeds
from patagium_lab.attack.packets import packet_text
from patagium_lab.attack.recordings import recordings

Read = Callable[[Path], object]


@dataclass(frozen=True, eq=False)
class Call:
    """Call of a verb in a folder of valid files.

    Attributes:
        words: Verb and its arguments.
        outputs: Files that it writes, and how each is read.
    """

    words: tuple[str, ...]
    outputs: dict[str, Read]

    @property
    def verb(self) -> str:
        """Name of the verb, with that of its group."""
        return " ".join(self.words[: 1 + (self.words[0] == "study")])


def page(path: Path) -> None:
    """Read a page: it is whole.

    Args:
        path: HTML.

    Raises:
        ValueError: If it has no end.
    """
    if "</html>" not in path.read_text("utf-8")[-200:]:
        raise ValueError("a page without an end")


def _picture(path: Path) -> None:
    if not path.read_bytes().startswith(b"\x89PNG") or b"IEND" not in path.read_bytes()[-20:]:
        raise ValueError("no whole picture")


def _anything(path: Path) -> None:
    if not path.read_bytes():
        raise ValueError("an empty file")


LEARNER = ("--network", "strip", "--hidden", "3", "--every", "5")
_FILTER = ("--prior-std", "0.3", "--measurement-std", "1e-2", "--spread", "1.7")
CALLS = (
    Call(
        ("simulate", "robot.yaml", "--frequency", "5 Hz", "--plunge", "35 deg", "--speed", "3 m/s",
         "--duration", "0.02", "--time-step", "1e-3", "-o", "out.nc", "--figure", "out.png"),
        {"out.nc": pt.load_flight, "out.png": _picture},
    ),
    Call(("cycles", "flight.nc", "--period", "0.02 s", "--skip", "0", "--figure", "cycles.png",
          "--table", "cycles.csv"),
         {"cycles.png": _picture, "cycles.csv": _anything}),
    Call(("view", "flight.nc", "-o", "view.html"), {"view.html": page}),
    Call(("view", "flight.nc", "--still", "view.png"), {"view.png": _picture}),
    Call(("inspect", "log.csv", "--json"), {}),
    Call(("import", "log.csv", "--map", "map.yaml", "-o", "log.nc"), {"log.nc": pt.load_log}),
    Call(("import", "log.csv", "--map", "map.yaml", "-o", "rows.csv"), {"rows.csv": _anything}),
    Call(("motion", "sensors.nc", "--robot", "robot.yaml", "-o", "motion.nc",
          "--plot", "motion.png"),
         {"motion.nc": _anything, "motion.png": _picture}),
    Call(
        ("identify", "flight.nc", *LEARNER, *_FILTER, "--model", "new.json",
         "--state", "new.state", "--predictions", "new.nc"),
        {"new.json": load_model, "new.state": pt.load_learner, "new.nc": load_identification},
    ),
    Call(("identify", "flight.nc", *LEARNER, *_FILTER, "--report", "report.html"),
         {"report.html": page, "report-replay.html": page}),
    Call(("tune", "flight.nc", *LEARNER, "--trials", "8", "--jobs", "1", "--out", "new.yaml"),
         {"new.yaml": load_settings}),
    Call(("evaluate", "strip.json", "flight.nc", "--report", "score.html"), {"score.html": page}),
    Call(
        ("stream", "packets.csv", "--robot", "robot.yaml", "--network", "strip", "--hidden", "3",
         *_FILTER, "--idle", "0.2",
         "--state", "own.state", "--record", "record.nc", "--model", "own.json"),
        {"own.state": pt.load_learner, "own.json": load_model, "record.nc": _anything},
    ),
    Call(("send", "flight.nc", "udp://127.0.0.1:9", "--rate", "4000"), {}),
    Call(("trim", "ornithopter", "--beats", "1", "-o", "trimmed.nc"),
         {"trimmed.nc": pt.load_flight}),
    Call(("fly", "ornithopter", "--duration", "0.05", "-o", "flown.nc", "--figure", "flown.png"),
         {"flown.nc": pt.load_flight, "flown.png": _picture}),
    Call(("fly", "tracked.yaml", "-o", "tracked.nc"), {"tracked.nc": pt.load_flight}),
    Call(
        ("optimize", "ornithopter", "--harmonics", "1", "--free", "frequency", "--beats", "1",
         "-o", "best.nc", "--gait", "best.csv"),
        {"best.nc": pt.load_flight, "best.csv": _anything},
    ),
    Call(("export", "flight.nc", "-o", "flight.mcap"), {"flight.mcap": _anything}),
    Call(("robots", "robot.yaml", "--draw", "robot.png"), {"robot.png": _picture}),
    Call(("check", "robot.yaml"), {}),
    Call(("cache", "--json"), {}),
    Call(
        ("simulate", "robot.yaml", "--frequency", "5 Hz", "--plunge", "35 deg", "--ground", "1 m",
         "--inflow", "--duration", "0.02", "--time-step", "1e-3", "-o", "near.nc"),
        {"near.nc": pt.load_flight},
    ),
    Call(("trim", "ornithopter", "--along", "speed=4.29:4.31", "--figure", "branch.png"),
         {"branch.png": _picture}),
    Call(("figures", "flight.nc", "--format", "png", "-o", "."),
         {"flight.png": _picture, "strips.png": _picture}),
)  # fmt: skip
"""Calls of each verb, short."""
STUDIES = tuple(
    Call(("study", name), {})
    for name in (
        "bench",
        "damage",
        "feedback",
        "foreign",
        "latency",
        "reproduce",
        "rig",
        "validate",
    )
)
"""Calls of the studies, which are long: they get hostile options and are stopped."""
OWN = ("study attack", "study stress")
"""Verbs of the attack itself, which start such programs and wait for them."""


def prepared(folder: Path) -> None:
    """Write the files that the calls read.

    Args:
        folder: Empty folder.
    """
    found = seeds.written(folder)
    logs = folder / "logs"
    logs.mkdir()
    log, words = recordings(logs)["CSV"]
    (folder / "log.csv").write_bytes(log.read_bytes())
    (folder / "map.yaml").write_text(yaml.safe_dump(words))
    (folder / "packets.csv").write_bytes(packet_text())
    load_identification(found["identification.nc"])
    learned = seeds.flight_learner()
    pt.identify(seeds.flight(), learned, every=5)
    from patagium.learning import save_model

    save_model(folder / "strip.json", learned)
