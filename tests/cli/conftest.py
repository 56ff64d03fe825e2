"""Commands run once per session: their answers are asked for by many tests."""

import contextlib
import io
import sys
from functools import wraps

import pytest
import yaml

import butterfly as bf
from butterfly.cli import main
from tests.conftest import brief_quickstart
from tests.experiment.setting import changed, written
from tests.verdicts import follow_nothing


@pytest.fixture(scope="session")
def answer():
    """Run a command, each at most once; returns exit code, stdout and stderr."""
    answers = {}

    def run(*arguments):
        words = tuple(map(str, arguments))
        if words not in answers:
            out, err = io.StringIO(), io.StringIO()
            with (
                pytest.MonkeyPatch.context() as patch,
                contextlib.redirect_stdout(out),
                contextlib.redirect_stderr(err),
            ):
                patch.setattr(sys, "argv", ["butterfly", *words])
                patch.setenv("COLUMNS", "80")
                with pytest.raises(SystemExit) as ended:
                    main()
            answers[words] = ended.value.code or 0, out.getvalue(), err.getvalue()
        return answers[words]

    return run


@pytest.fixture(scope="session")
def saved(answer, quick_data, tmp_path_factory):
    """A saved identification of `quick_data`, with its page and its numbers beside it."""
    folder = tmp_path_factory.mktemp("place")
    told = ("--report", folder / "r.html", "--json", folder / "told.json")
    assert answer("identify", quick_data, "--save", folder / "saved.json", *told)[0] == 0
    return folder / "saved.json"


@pytest.fixture(scope="session")
def place(answer, saved):
    """A folder with what the commands work with: a saved identification, results of a run."""
    folder = saved.parent
    quick = brief_quickstart(folder, "grey-box", few=2)
    changed(quick, estimators=[{"method": "output-error", "terms": []}])
    run = answer("run", quick, "--out", folder / "results/one")
    assert run[0] == 0, run
    return folder


@pytest.fixture(scope="session")
def few_data(quick_data, tmp_path_factory):
    """The manifest of two logs with each mass of `quick_data`."""
    content = yaml.safe_load((quick_data / "manifest.yaml").read_text())
    logs = [content["logs"][number] for number in (0, 2, 3, 5, 6, 8)]
    path = tmp_path_factory.mktemp("few") / "few.yaml"
    return written(path, **content | {"root": str(quick_data), "logs": logs})


@pytest.fixture(scope="session")
def unfit(saved, tmp_path_factory):
    """A saved identification of `quick_data` that does not follow the logs well enough."""
    file = tmp_path_factory.mktemp("unfit") / "saved.json"
    with pytest.MonkeyPatch.context() as patch:
        follow_nothing(patch)
        bf.identify(saved, "output-error", terms=()).save(file)
    return file


@pytest.fixture
def told(butterfly, saved, monkeypatch):
    """Run `identify` as if it found a result that is given."""

    def run(found, *options):
        monkeypatch.setattr(bf, "identify", wraps(bf.identify)(lambda *_, **__: found))
        return butterfly("identify", saved, *options)

    return run
