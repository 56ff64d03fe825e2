"""From the command line to logs that are read back."""

import numpy as np
import pytest

can = pytest.importorskip("can", reason="python-can is not installed (extra 'can')")

from butterfly.identification.data import read_data_set
from butterfly.logs.log import InputKind, Sine
from butterfly.logs.manifest import read_manifest
from butterfly.model.prior import Known
from examples import record_sines
from examples.odrive_stand_in import ZERO, WaitingBus

SHORT = ["--rehearse", "--seconds", "5"]


def test_a_rehearsal_leaves_a_data_set_whose_gain_is_known(tmp_path, capsys):
    record_sines.main(
        [*SHORT, "--uncertainty", "0.03", "--omegas", "4", "8", "--out", f"{tmp_path}"]
    )
    assert "4_rad_s.csv: the joint swings over" in capsys.readouterr().out
    manifest = read_manifest(tmp_path / "manifest.yaml")
    assert manifest.prior.parameters == {"p4": Known(value=1.0, uncertainty=0.03)}
    logs = read_data_set(manifest).logs
    assert [log.excitation for log in logs] == [Sine(omega=w, amplitude=0.1) for w in (4.0, 8.0)]
    for log in logs:
        assert log.input_kind is InputKind.TORQUE
        assert log.angle[0] == pytest.approx(ZERO, abs=0.02)  # where friction holds it
        expected = log.excitation.sample(log.time - log.time[0])
        np.testing.assert_allclose(log.input, expected, atol=1e-7)


def test_a_joint_that_keeps_moving_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(record_sines, "STILL", 0.0)
    monkeypatch.setattr(record_sines, "PATIENCE", 2)
    with pytest.raises(SystemExit, match="Stopped: the joint still moves after 2 s"):
        record_sines.main([*SHORT, "--out", f"{tmp_path}"])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("option", "said"),
    [("--amplitude", "Stopped: excitation: amplitude"), ("--limit", "Stopped: CommandPath: limit")],
)
def test_what_cannot_be_is_refused_in_a_line(tmp_path, option, said):
    with pytest.raises(SystemExit, match=said):
        record_sines.main([*SHORT, option, "0", "--out", f"{tmp_path}"])


def test_a_bus_that_cannot_be_opened_is_named(monkeypatch):
    def missing(**_):
        raise OSError("No such device")

    monkeypatch.setattr(can, "Bus", missing)
    with pytest.raises(SystemExit, match="Stopped: no bus can7 of socketcan: No such device"):
        record_sines.main(["--channel", "can7"])


def test_a_bus_that_fails_is_not_said_to_have_stopped_the_joint(tmp_path, monkeypatch):
    def full(*_):
        raise can.CanOperationError("full")

    monkeypatch.setattr(WaitingBus, "send", full)
    with pytest.raises(SystemExit, match=r"No message gets through: full\. .* its watchdog alone"):
        record_sines.main([*SHORT, "--out", f"{tmp_path}"])
