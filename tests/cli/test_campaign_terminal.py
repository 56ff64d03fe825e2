"""A campaign on a terminal, and where nobody is at a keyboard."""

import pytest

from butterfly.cli import campaign_terminal
from butterfly.cli.campaign_terminal import CampaignTerminal
from butterfly.cli.output import ExitCode
from butterfly.errors import StoppedError
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from butterfly.plant.motor import Reading

ROBOT = """
from butterfly.logs.log import InputKind


class Untouched:
    input_kind = InputKind.{kind}

    def _never(self, *_):
        raise AssertionError("a motor was touched")

    start = stop = command = read = wait = _never


def motor():
    return Untouched()


def broken():
    raise RuntimeError("no such port")
"""
ASKED = ("--command", "0.2", "--out")


def answering(questions, *answers):
    """Return what keeps questions, and answers them, in the end with Enter alone."""
    left = list(answers)

    def answer(question):
        questions.append(question)
        return left.pop(0) if left else ""

    return answer


@pytest.fixture
def robot(tmp_path, monkeypatch):
    """Write a module with a motor that takes a kind of command."""
    monkeypatch.chdir(tmp_path)

    def written(name, kind="TORQUE"):
        (tmp_path / f"{name}.py").write_text(ROBOT.format(kind=kind), encoding="utf-8")
        return f"{name}:motor"

    return written


def test_without_a_keyboard_nothing_moves_and_it_says_what_it_needs(butterfly, robot, tmp_path):
    code, _, error = butterfly("campaign", robot("robot_a"), *ASKED, tmp_path / "a")
    assert code == ExitCode.BAD_INPUT == 2
    assert "no keyboard" in error
    assert "--yes" in error
    masses = ("--masses", "0,0.1", "--arm", "0.1", "--yes")
    code, _, error = butterfly("campaign", robot("robot_b"), *ASKED, tmp_path / "a", *masses)
    assert code == ExitCode.BAD_INPUT
    assert "--masses" in error
    assert not (tmp_path / "a").exists()


def test_a_drive_of_set_points_is_refused_with_the_mode_to_use(butterfly, robot, tmp_path):
    servo = robot("robot_c", "SETPOINT")
    code, _, error = butterfly("campaign", servo, *ASKED, tmp_path / "a", "--yes")
    assert code == ExitCode.BAD_INPUT
    assert "operating mode 0" in error
    assert "loop that no option" not in error


def test_a_factory_that_raises_is_one_line(butterfly, robot, tmp_path):
    name = robot("robot_d").replace("motor", "broken")
    code, _, error = butterfly("campaign", name, *ASKED, tmp_path / "a", "--yes")
    assert code == ExitCode.BAD_INPUT
    assert "no such port" in error
    assert error.count("\n") == 1


def test_the_first_motion_waits_for_enter_and_says_how_to_stop(monkeypatch, capsys):
    questions = []
    monkeypatch.setattr("builtins.input", answering(questions))
    CampaignTerminal(asks=True, moves=True).begin(["It will swing."])
    assert "Enter" in questions[0]
    assert "It will swing." in (told := capsys.readouterr().err)
    assert "Ctrl-C" in told
    CampaignTerminal(asks=False, moves=True).begin([])
    assert len(questions) == 1


def test_only_enter_begins_a_motion(monkeypatch):
    questions = []
    monkeypatch.setattr("builtins.input", answering(questions, "n", "what?", " "))
    CampaignTerminal(asks=True, moves=True).begin([])
    assert len(questions) == 3


def test_what_precedes_a_motion_is_said_with_quiet_too(monkeypatch, capsys):
    monkeypatch.setattr(campaign_terminal.asked, "quiet", True)
    monkeypatch.setattr("builtins.input", answering([]))
    CampaignTerminal(asks=True, moves=True).begin(["It will swing."])
    assert "It will swing." in capsys.readouterr().err
    CampaignTerminal(asks=False, moves=True).phase("Run 0.")
    assert not capsys.readouterr().err


def test_a_mass_is_asked_for_in_words_that_hold_after_a_pause_too(monkeypatch):
    questions = []
    monkeypatch.setattr("builtins.input", answering(questions))
    terminal = CampaignTerminal(asks=False, moves=True)
    terminal.mount(AddedMass(mass=0.1, arm=0.1))
    terminal.mount(NO_ADDED_MASS)
    assert "with 100 g at 100 mm: mount that, unless it is mounted" in questions[0]
    assert "with no added mass" in questions[1]


def test_a_keyboard_that_is_gone_ends_it_in_words(monkeypatch):
    def gone(_):
        raise EOFError

    monkeypatch.setattr("builtins.input", gone)
    with pytest.raises(StoppedError, match="the same command continues"):
        CampaignTerminal(asks=False, moves=True).mount(NO_ADDED_MASS)


def test_a_line_shows_angle_and_command_while_the_joint_moves(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    clock = iter(range(100))
    monkeypatch.setattr(campaign_terminal.time, "monotonic", lambda: 0.06 * next(clock))
    monkeypatch.setattr(campaign_terminal.select, "select", lambda *_: ([], [1], []))
    terminal = CampaignTerminal(asks=False, moves=True)
    for cycle in range(20):
        terminal.cycle(Reading(0.002 * cycle, 0.25, 0.0), -0.5)
    shown = capsys.readouterr().err
    assert "+0.250 rad" in shown
    assert "-0.5" in shown
    assert 5 <= shown.count("\r") <= 10  # not faster than anybody reads
    monkeypatch.setattr(campaign_terminal.select, "select", lambda *_: ([], [], []))
    terminal.cycle(Reading(1.0, 0.25, 0.0), -0.5)  # the terminal stands: the robot does not wait
    assert not capsys.readouterr().err
