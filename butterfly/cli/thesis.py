"""`butterfly reproduce`: the thesis's figures."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from butterfly.cli.options import Out
from butterfly.cli.output import say, show_table, write_json
from butterfly.files import shipped

if TYPE_CHECKING:
    from butterfly.thesis.tables import Synthetic


def reproduce(
    what: Annotated[Literal["thesis"], Parameter(name="WHAT")],  # noqa: ARG001 - there is no other
    /,
    *,
    root: Annotated[Path | None, Parameter(metavar="FOLDER")] = None,
    out: Out = None,
) -> None:
    """Print the thesis's figures beside those obtained the same way, and the right ones.

    Example: butterfly reproduce thesis --out figures

    Parameters
    ----------
    what
        What to reproduce: thesis.
    root
        Folder of the 41 real logs, if not fetched.
    out
        Write the data of Figures 3-12 to this folder.
    """
    from butterfly.result import document  # noqa: PLC0415 - slow to import
    from butterfly.thesis.figure_data import write_figure_data  # noqa: PLC0415
    from butterfly.thesis.tables import has_real_logs, reproduce  # noqa: PLC0415

    synthetic = thesis_robot()
    rows = reproduce(synthetic, root)
    show_table(
        "The thesis, published against obtained",
        ("figures", "published", "obtained", "same", "right"),
        [
            (row.what, row.published, row.obtained, "yes" if row.agrees else "no", row.corrected)
            for row in rows
        ],
    )
    for row in rows:
        if row.note:
            say(f"{row.what}: {row.note}")
    if not has_real_logs(root):
        say("Tables 4 and 5 need the real logs: run `butterfly fetch`, or give --root.")
    if out is not None:
        for path in write_figure_data(out, synthetic, root):
            say(f"Figure data: {path}")
    alike = sum(row.agrees for row in rows)
    write_json(
        document(
            "reproduction",
            "The thesis, published against obtained",
            {"rows": [{**asdict(row), "same": row.agrees} for row in rows]},
            summary=(f"{alike} of {len(rows)} are the same.",),
        )
    )


def thesis_robot() -> Synthetic:
    """Return what Tables 1 and 2 and Figures 3 to 8 rest on."""
    from butterfly.experiment.source import read_experiment  # noqa: PLC0415
    from butterfly.thesis.tables import Synthetic  # noqa: PLC0415

    experiment = read_experiment(shipped("experiments/thesis/synthetic.yaml"))
    return Synthetic(
        rig=experiment.plant.rig,
        added_masses=experiment.added_masses,
        sines=experiment.excitations,
        duration=experiment.duration,
    )
