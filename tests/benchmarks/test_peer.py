"""Against mujoco.sysid, on the same simulated logs in the same run, on one core (extra ``sysid``).

Both have the logs in memory; mujoco.sysid its models and sequences too, which it is given ready.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError
from butterfly.identification.estimators.multistart import Start
from butterfly.logs.log import Sine
from butterfly.model.parameters import AddedMass, Friction, Hand, TorqueDrive
from butterfly.plant.rig import Rig
from butterfly.plant.robot import Robot
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Clock, Encoder
from tests.benchmarks.bars import count_missing, measured
from tests.benchmarks.cpu_time import least_seconds
from tests.plant.setting import mjcf

_LOGS = "mujoco.sysid, 6 logs, 4 parameters"
FASTER = (f"{_LOGS}: from the logs on", f"{_LOGS}: the fit")
"""How many times faster output error is."""

try:
    from mujoco import sysid

    sysid.ParameterDict  # noqa: B018 - a part of it comes with MuJoCo itself
except (ImportError, AttributeError):
    for what in FASTER:
        count_missing(what, "mujoco.sysid is not installed: pip install -e '.[sysid]'")
    pytest.skip("mujoco.sysid is not installed", allow_module_level=True)

ROBOT = Robot(
    hand=Hand(mass=0.1, com_distance=0.05, inertia=0.003),
    drive=TorqueDrive(gain=0.025),
    friction=Friction(viscous=1e-3),
)
MASSES = [AddedMass(mass=mass, arm=0.104) for mass in (0.0, 0.05, 0.12)]
STEP = 0.005  # s
INERTIA, DISTANCE, DAMPING, GAIN = 0.0024, 0.06, 8e-4, 0.03
"""Where fits start: 20 % off, in kg m^2, m, N m s/rad and N m."""


@pytest.fixture(scope="module")
def logs():
    rig = Rig(robot=ROBOT, clock=Clock(step=STEP), encoder=Encoder(steps=32768, noise=2e-4))
    runs = [(mass, Sine(omega=w, amplitude=0.15)) for mass in MASSES for w in (3.5, 5.5)]
    seeds = np.random.SeedSequence(0).spawn(len(runs))
    return list(simulate_runs(rig, runs, 70.0, seeds))


def _lumped(inertia, distance, damping, gain):
    """p1, p2, p3, p4."""
    mass = ROBOT.hand.mass
    return np.array([inertia + mass * distance**2, damping, mass * 9.81 * distance, gain])


def _peer(logs):
    """What finds p1, p2, p3, p4 by mujoco.sysid, as its documentation shows."""

    def inertia(spec, parameter):
        spec.body("hand").inertia = [float(parameter.value[0])] * 3

    def place(spec, parameter):
        spec.body("hand").ipos = [0, 0, -float(parameter.value[0])]

    def damping(spec, parameter):
        spec.joint("hinge").damping = [float(parameter.value[0]), 0, 0]

    def gain(spec, parameter):
        spec.actuator("motor").gainprm[0] = float(parameter.value[0])

    guesses = {
        "inertia": (INERTIA, 1e-4, 0.1, inertia),
        "place": (DISTANCE, -0.5, 0.5, place),
        "damping": (DAMPING, 0.0, 0.1, damping),
        "gain": (GAIN, 1e-4, 1.0, gain),
    }
    parameters = sysid.ParameterDict(
        {
            name: sysid.Parameter(name, nominal, low, high, modifier=modifier)
            for name, (nominal, low, high, modifier) in guesses.items()
        }
    )
    sequences = []
    for k, log in enumerate(logs):
        spec = mujoco.MjSpec.from_string(mjcf(ROBOT, log.added_mass))
        spec.option.timestep = STEP
        for sensor in list(spec.sensors):
            if sensor.name != "angle":
                spec.delete(sensor)
        model = spec.compile()
        state = sysid.create_initial_state(model, np.zeros(1))
        control = sysid.TimeSeries(log.time, log.input[:, None])
        mapping = {"angle": (sysid.SignalType.MjSensor, np.array([0]))}
        measured = sysid.TimeSeries(log.time, log.angle[:, None], mapping)
        sequences.append(sysid.ModelSequences(f"{k}", spec, f"{k}", state, control, measured))
    residual = sysid.build_residual_fn(models_sequences=sequences)

    def fit():
        # The fastest of its optimisers here.
        found, _ = sysid.optimize(parameters, residual, optimizer="scipy", verbose=False)
        return _lumped(*(float(found[name].value[0]) for name in guesses))

    return fit


def test_output_error_is_hundreds_of_times_faster_at_no_larger_error(logs):
    """Both from the same start, and ours from the bare logs on, with coulomb torque and delay."""
    truth = _lumped(0.003, 0.05, 1e-3, 0.025)
    p1, p2, p3, p4 = _lumped(INERTIA, DISTANCE, DAMPING, GAIN)
    start = replace(ROBOT.lumped, p1=p1, p2=p2, p3=p3, p4=p4)
    whole = OutputError(terms=(), workers=1)
    four = replace(whole, fixed=("coulomb", "delay"))
    found = {}

    def record(name, fit):
        found[name] = fit()

    def from_logs():
        return whole(DataSet.of(logs)).values[:4]

    def from_start():
        return four.of_logs(logs, [Start(start, dict.fromkeys(MASSES, 0.0))]).values

    from_logs()  # compiles
    peer = _peer(logs)
    ours, same = least_seconds(
        lambda: record("from the logs", from_logs),
        lambda: record("from the same start", from_start),
    )
    (theirs,) = least_seconds(lambda: record("mujoco.sysid", peer), repeats=1)
    errors = {name: float(np.linalg.norm(values / truth - 1)) for name, values in found.items()}
    print(
        f"\n6 logs of 70 s, 4 parameters: mujoco.sysid {theirs:.1f} s; output error {ours:.3f} s, "
        f"{theirs / ours:.0f} times faster, with data set, start, Coulomb torque and delay; from "
        f"mujoco.sysid's start {same:.3f} s, {theirs / same:.0f} times; errors "
        + ", ".join(f"{name} {error:.1e}" for name, error in errors.items())
    )
    for seconds, what in zip((ours, same), FASTER, strict=True):
        measured(what, theirs / seconds)
    peer_s = errors.pop("mujoco.sysid")
    for name, error in errors.items():
        measured(f"error of output error {name}", error / peer_s)


def test_one_log_without_a_known_mass_is_refused_here_and_answered_there(logs):
    with pytest.raises(IdentifiabilityError, match="common factor"):
        OutputError()(DataSet.of(logs[:1]))
    assert np.isfinite(_peer(logs[:1])()).all()
