"""No command writes over an input, over a file that is not its own, or two outputs to one path."""

import json
import shutil
from dataclasses import is_dataclass
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

import butterfly as bf
from butterfly.cli.app import COMMANDS
from butterfly.cli.output import options_of
from butterfly.logs.csv import write_csv
from tests.cli.one_line import assert_one_line_error

OF_FOLDER = dict.fromkeys(("manifest", "identify", "select"), "logs")
OF_RESULT = dict.fromkeys(("design", "residual", "export", "show"), "result.json")
OF_SWEEP = {"results clean": "results"}
OF_EXPERIMENT = ("run", "simulate", "campaign")
ABOUT = {
    **OF_FOLDER
    | OF_RESULT
    | OF_SWEEP
    | dict.fromkeys(("run", "simulate", "campaign"), "plan.yaml"),
    "inspect": "logs/run0.csv",
    "fetch": "--from logs",
    "validate": "logs result.json",
    "predict": "logs/run0.csv --with result.json",
    "compare": "result.json other.json",
    "library list": "",
    "library show": "xl330",
    "library draft": "result.json",
    "schema": "",
    "report": "logs --with result.json",
    "reproduce": "thesis",
}
CALLS = {name: f"{name} {about}" for name, about in ABOUT.items()}
"""A call of each command, on files of the folder."""


def command_of(name):
    return COMMANDS[name].functions()[name]


def _outputs(name):
    """Return the options of a command that write, and the endings of their files."""
    found = {option: written.endings for option, written in options_of(command_of(name)).values()}
    return found | ({"--json": (".json",)} if COMMANDS[name].answer else {})


WRITING = [(name, option) for name in COMMANDS for option in _outputs(name)]


@pytest.fixture(scope="module")
def files(saved, quick_data, tmp_path_factory):
    """What the calls read, and files of somebody else, to be copied."""
    made = tmp_path_factory.mktemp("files")
    (made / "logs").mkdir()
    for number, log in enumerate(bf.read(quick_data).logs[:2]):
        write_csv(log, made / f"logs/run{number}.csv")
    shutil.copy(quick_data / "manifest.yaml", made / "logs/manifest.yaml")
    shutil.copy(quick_data.parent / "quick.yaml", made / "plan.yaml")
    for name in ("result.json", "other.json"):
        shutil.copy(saved, made / name)
    (made / "results").mkdir()
    for ending in [
        "html",
        "json",
        "csv",
        "parquet",
        "yaml",
        "yml",
        "xml",
        "urdf",
        "h",
        "py",
        "zip",
    ]:
        (made / f"theirs.{ending}").write_text("t,u,q\n0,0,0\n")
    for ending in ["gif", "mp4", "webp", "png", "jpg", "jpeg"]:
        (made / f"theirs.{ending}").write_bytes(b"\x89PNG of somebody")
    (made / "folder.d").mkdir()
    (made / "folder.d/theirs.txt").write_text("text")
    (made / "link.json").symlink_to("result.json")
    return made


@pytest.fixture
def folder(files, tmp_path, monkeypatch):
    """A folder with them."""
    monkeypatch.chdir(tmp_path)
    return shutil.copytree(files, tmp_path, symlinks=True, dirs_exist_ok=True)


def _contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _paths(command):
    """Return the names of options that are paths, in dataclasses too."""
    for name, hint in get_type_hints(command).items():
        if is_dataclass(hint):
            yield from _paths(hint)
        elif Path in (hint, *get_args(hint)):
            yield name


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_that_is_a_path_beside_the_inputs_says_what_it_writes(name):
    known = {
        "data",
        "more",
        "other",
        "source",
        "result",
        "experiment",
        "folder",
        "robot",
        "root",
        "model",
        "into",
    }
    writing = {way[-1] for way in options_of(command_of(name))}
    for option in _paths(command_of(name)):
        assert option in known | writing, f"what is written by {option}?"


@pytest.mark.parametrize(("name", "option"), WRITING)
def test_no_output_is_an_input_or_a_file_of_somebody_else(butterfly, folder, name, option):
    endings = _outputs(name)[option]
    taken = ["logs/run0.csv", "logs/manifest.yaml", "plan.yaml", "link.json"]
    taken += ["result.json"] * ("result.json" in CALLS[name] or option != "--save")
    taken += [f"theirs{ending}" for ending in endings if ending]
    taken += ["folder.d"] * (endings != () and "" not in endings)
    before = _contents(folder)
    for path in taken:
        assert_one_line_error(butterfly(*CALLS[name].split(), option, path), path, option)
        assert _contents(folder) == before, path


def test_an_input_is_known_by_any_of_its_names(butterfly, folder):
    (folder / "same.json").hardlink_to(folder / "result.json")
    before = _contents(folder)
    for path in ("same.json", "logs/../result.json", folder / "result.json"):
        said = butterfly("identify", "result.json", "--save", path)
        assert_one_line_error(said, "--save", "a file that is read here")
        assert _contents(folder) == before


@pytest.mark.parametrize("document", ["x.json", "folder.d/../x.json"])
def test_two_outputs_have_two_paths(butterfly, folder, document):
    said = butterfly("identify", "logs", "--json", document, "--save", "x.json")
    assert_one_line_error(said, "--save", "the file of")
    assert not (folder / "x.json").exists()


@pytest.mark.parametrize("report", ["x.html", "folder.d/../x.html"])
def test_a_page_and_the_saved_result_or_the_json_may_have_one_name(butterfly, folder, report):
    assert butterfly("identify", "result.json", "--report", report, "--save", "x.json")[0] != 2
    assert bf.load("x.json").kind == "identification"
    assert butterfly("inspect", "logs/run0.csv", "--report", "y.html", "--json", "y.json")[0] == 0
    assert json.loads((folder / "y.json").read_text())["schema"] == "butterfly.inspection"
    assert (folder / "x.html").exists()
    assert (folder / "y.html").exists()


def test_what_butterfly_wrote_as_the_same_kind_is_replaced(butterfly, folder):
    for words in (
        ("inspect", "logs/run0.csv", "--report", "p.html"),
        ("schema", "--out", "s.json", "--overwrite"),
        ("show", "result.json", "--out", "hand.png", "--size", 16),
    ):
        for _ in range(2):
            assert butterfly(*words)[0] == 0, words
    said = butterfly("inspect", "result.json", "--json", "p.json")
    assert_one_line_error(said, "p.json", "another kind")
    assert_one_line_error(butterfly("schema", "--out", "s.json"), "s.json", "--overwrite")
    assert json.loads((folder / "p.json").read_text())["schema"] == "butterfly.inspection"


@pytest.mark.usefixtures("folder", "brief_twins")
@pytest.mark.filterwarnings("ignore:The delay")
def test_twins_and_draws_are_marked():
    found = bf.load("result.json")
    drawn = bf.draws(found, 3)
    for _ in range(2):
        for path in ("draws.parquet", "draws", "draws.PARQUET"):
            drawn.write(path)
        found.model.export("twin.xml")
        found.model.export("twin.h", to="c", overwrite=True)
    with pytest.raises(bf.InputError, match="another kind"):
        found.model.export("draws/0000.xml")
    with pytest.raises(bf.InputError, match=r"or \.parquet"):
        drawn.write("d.xlsx")
    with pytest.raises(bf.InputError, match=r"\.c; expected \.h"):
        found.model.export("twin.c", to="c")


def test_a_saved_result_is_not_the_numbers_of_a_report(folder):
    found = bf.load("result.json")
    found.save("mine.json")
    with pytest.raises(bf.InputError, match="another kind"):
        found.report("mine.html")
    assert not (folder / "mine.html").exists()
    found.save("mine.json")
    found.report("page.html")
    found.report("page.html")


def test_results_and_logs_go_to_folders_of_their_own(butterfly, folder, monkeypatch):
    before = _contents(folder)
    for words in (("run", "plan.yaml", "--out", "."), ("run", "plan.yaml", "--out", "folder.d")):
        assert_one_line_error(butterfly(*words), "--out", "a new folder")
    with monkeypatch.context() as unsimulated:
        unsimulated.delattr("butterfly.experiment.run.simulate_runs")
        for words in (("simulate", "plan.yaml", "--out", "logs"), ("manifest", "logs")):
            assert_one_line_error(butterfly(*words), "manifest.yaml", "--overwrite")
    assert _contents(folder) == before
    assert butterfly("simulate", "plan.yaml", "--out", "logs", "--overwrite")[0] == 0
    assert (folder / "logs/run0.csv").exists()
