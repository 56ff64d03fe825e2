"""`bundle`: what to attach to a report of an error."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from butterfly.api.saved import read_saved
from butterfly.api.sources import Named, manifest_of, names_result, require_said
from butterfly.arguments import checked
from butterfly.files import locate
from butterfly.logs.manifest import Manifest
from butterfly.outputs import require_endings
from butterfly.progress import Track, untracked
from butterfly.report.bundle import attempted, bundle_files, write_bundle


@checked
def bundle(
    data: Named | None = None,
    path: Named | None = None,
    *,
    result: Named | None = None,
    logs: bool = False,
    root: Named | None = None,
    track: Track = untracked,
    **description: Any,  # noqa: ANN401 - what `read` takes
) -> dict[str, str]:
    """Collect what helps others to see what went wrong, without names, paths and texts of yours.

    Versions; facts of the manifest, and the health of the logs; level, parameters and kinds of
    findings of a result. Data that cannot be read are no error here: the bundle says where reading
    them ended. Nothing is fitted.

    Parameters
    ----------
    data
        As in `read`: logs, a folder of logs, a manifest or a saved result.
    path
        Zip file (.zip) to write; default: none. It replaces nothing but another bundle.
    result
        Saved result.
    logs
        Also the samples of the logs, each clock from 0, in files named log-1.csv and so on.
    root
        Folder of the logs, if not the manifest's.
    track
        Progress callback.
    description
        Fields of a manifest, as in `read`.

    Returns
    -------
    files
        The texts of the bundle, by name. The first lines of ``report.txt`` say what is in it.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    if path is not None:
        require_endings(Path(path), (".zip",))
    saved = data if result is None and data is not None and names_result(data) else result
    files = bundle_files(
        None if data is None else attempted(partial(_manifest, data, root, description)),
        None if saved is None else attempted(partial(read_saved, Path(saved))),
        samples=logs,
        track=track,
    )
    if path is not None:
        write_bundle(files, Path(path))
    return files


def _manifest(data: Named, root: Named | None, description: dict[str, Any]) -> Manifest:
    manifest = manifest_of(data, root=root, massless=True, **description)
    require_said(locate(Path(data)), manifest)
    return manifest
