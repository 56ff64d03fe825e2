"""Against others' fits of the same simulated logs, in the same run on one core (extra ``bench``).

All have the logs in memory; mujoco.sysid its models and sequences too, which it is given ready.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mujoco import sysid
from scipy.optimize import least_squares

from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError
from butterfly.identification.problem import Start
from butterfly.logs.log import Sine
from butterfly.model.parameters import AddedMass, Friction, Hand, TorqueDrive
from butterfly.plant.rig import Rig
from butterfly.plant.robot import Robot
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Clock, Encoder
from tests.benchmarks.bars import count_missing, measured
from tests.benchmarks.cpu_time import least_seconds
from tests.benchmarks.plain_loop import swing
from tests.plant.setting import mjcf

try:
    import lmfit
except ImportError:
    lmfit = None

OURS, PEER = "output error from the logs on, 6 parameters", "mujoco.sysid, 6 logs, 4 parameters"
SYSID = (f"{PEER}: from the logs on", f"{PEER}: the fit")
SYSID += ("error of output error from the logs", "error of output error from the same start")
ROBOT = Robot(
    hand=Hand(mass=0.1, com_distance=0.05, inertia=0.003),
    drive=TorqueDrive(gain=0.025),
    friction=Friction(viscous=1e-3),
)
MASSES = [AddedMass(mass=mass, arm=0.104) for mass in (0.0, 0.05, 0.12)]
STEP = 0.005  # s
FIRST = {"inertia": 0.0024, "place": 0.06, "damping": 8e-4, "gain": 0.03}
"""Where fits start: 20 % off, in kg m^2, m, N m s/rad and N m."""


@pytest.fixture(scope="module")
def logs():
    rig = Rig(robot=ROBOT, clock=Clock(step=STEP), encoder=Encoder(steps=32768, noise=2e-4))
    runs = [(mass, Sine(omega=w, amplitude=0.15)) for mass in MASSES for w in (3.5, 5.5)]
    seeds = np.random.SeedSequence(0).spawn(len(runs))
    return list(simulate_runs(rig, runs, 70.0, seeds))


def _count_missing(name, *rows):
    for what in rows:
        count_missing(what, f"{name} is not installed: pip install -e '.[bench]'")


def _lumped(inertia, place, damping, gain):
    """p1, p2, p3, p4."""
    mass = ROBOT.hand.mass
    return np.array([inertia + mass * place**2, damping, mass * 9.81 * place, gain])


TRUTH, START = _lumped(0.003, 0.05, 1e-3, 0.025), _lumped(**FIRST)


def _error(values):
    return float(np.linalg.norm(values / TRUTH - 1))


def _script(logs):
    """The residuals of p1, p2, p3, p4, as factors of their start, by a plain loop."""
    loads = [(log.added_mass.mass, log.added_mass.arm) for log in logs]
    held = [np.repeat(log.input[:-1, None], 3, axis=1) for log in logs]

    def residuals(factors):
        p1, p2, p3, p4 = START * factors
        loaded = [(p1 + m * arm**2, p2, p3 + 9.81 * m * arm, 0.0) for m, arm in loads]
        runs = zip(loaded, held, logs, strict=True)
        return np.concatenate(
            [swing(own, p4 * each, STEP, log.angle[0]) - log.angle for own, each, log in runs]
        )

    return residuals


def test_output_error_takes_no_longer_than_a_script_of_twenty_lines(logs):
    """Which knows that nothing rubs or lags: told to fit Coulomb friction, lmfit ends elsewhere."""
    residuals, found = _script(logs), {}

    def by_scipy():
        found["SciPy"] = START * least_squares(residuals, np.ones(4)).x

    def by_lmfit():
        guess = lmfit.create_params(p1=1.0, p2=1.0, p3=1.0, p4=1.0)
        fit = lmfit.minimize(lambda p: residuals(np.array(list(p.valuesdict().values()))), guess)
        found["lmfit"] = START * np.array(list(fit.params.valuesdict().values()))

    def from_logs():
        found["ours"] = OutputError(terms=(), workers=1)(DataSet.of(logs)).values[:4]

    fits = {OURS: by_scipy} | ({"the same fit": by_lmfit} if lmfit else {})
    if not lmfit:
        _count_missing("lmfit", "the same fit")
    for each in (from_logs, by_scipy):  # compiles
        each()
    ours, *theirs = least_seconds(from_logs, *fits.values())
    assert max(map(_error, found.values())) < 1e-3
    measured({what: ours / each for what, each in zip(fits, theirs, strict=True)})


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

    spans = (1e-4, 0.1, inertia), (-0.5, 0.5, place), (0.0, 0.1, damping), (1e-4, 1.0, gain)
    parameters = sysid.ParameterDict(
        {
            name: sysid.Parameter(name, nominal, low, high, modifier=modifier)
            for (name, nominal), (low, high, modifier) in zip(FIRST.items(), spans, strict=True)
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
        angles = sysid.TimeSeries(log.time, log.angle[:, None], mapping)
        sequences.append(sysid.ModelSequences(f"{k}", spec, f"{k}", state, control, angles))
    residual = sysid.build_residual_fn(models_sequences=sequences)

    def fit():
        # The fastest of its optimisers here.
        found, _ = sysid.optimize(parameters, residual, optimizer="scipy", verbose=False)
        return _lumped(**{name: float(found[name].value[0]) for name in FIRST})

    return fit


@pytest.fixture
def peer():
    """What makes a fit of logs by mujoco.sysid, a part of which comes with MuJoCo itself."""
    if not hasattr(sysid, "ParameterDict"):
        _count_missing("mujoco.sysid", *SYSID)
        pytest.skip("mujoco.sysid is not installed")
    return _peer


def test_output_error_is_hundreds_of_times_faster_at_no_larger_error(logs, peer):
    """Both from the same start, and ours from the bare logs on, with coulomb torque and delay."""
    whole, found = OutputError(terms=(), workers=1), []
    four = replace(whole, fixed=("coulomb", "delay"))
    start = replace(ROBOT.lumped, **dict(zip(("p1", "p2", "p3", "p4"), START, strict=True)))

    def from_logs():
        return whole(DataSet.of(logs)).values[:4]

    def from_start():
        return four.of_logs(logs, [Start(start, dict.fromkeys(MASSES, 0.0))]).values

    errors = [_error(fit()) for fit in (from_logs, from_start)]  # compiles
    seconds = least_seconds(from_logs, from_start)
    fit = peer(logs)
    (theirs,) = least_seconds(lambda: found.append(fit()), repeats=1)
    ratios = [theirs / each for each in seconds] + [each / _error(found[0]) for each in errors]
    measured(dict(zip(SYSID, ratios, strict=True)))


def test_one_log_without_a_known_mass_is_refused_here_and_answered_there(logs, peer):
    with pytest.raises(IdentifiabilityError, match="common factor"):
        OutputError()(DataSet.of(logs[:1]))
    assert np.isfinite(peer(logs[:1])()).all()
