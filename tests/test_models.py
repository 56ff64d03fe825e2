"""The robots of models/ weigh what the parts that their pages list weigh."""

import mujoco
import numpy as np
import pytest

from butterfly.files import shipped

X, Y, Z = np.eye(3)
CYLINDERS, TUBES, BOXES, BALLS = "cylinders", "tubes", "boxes", "balls"
PARTS = {  # of each body: kind, mass, place or both ends, axis or size, radius, length
    "arm/arm.xml": {
        "turntable": [
            (CYLINDERS, 0.3, 0.02 * Z, Z, 0.05, 0.04),
            (CYLINDERS, 0.4, 0.06 * Z, Y, 0.03, 0.06),
        ],
        "upper_arm": [
            (TUBES, 0.2, 0 * X, 0.2 * X, 0.012),
            (CYLINDERS, 0.25, 0.2 * X, Y, 0.025, 0.05),
        ],
        "forearm": [
            (TUBES, 0.15, 0 * X, 0.18 * X, 0.012),
            (CYLINDERS, 0.15, 0.18 * X, Y, 0.018, 0.04),
        ],
        "wrist": [
            (TUBES, 0.05, 0 * X, 0.06 * X, 0.012),
            (CYLINDERS, 0.15, 0.06 * X, X, 0.018, 0.04),
        ],
        "gripper": [(BOXES, 0.2, 0.04 * X, (0.08, 0.04, 0.03))],
    },
    "leg/leg.xml": {
        "hip": [(CYLINDERS, 0.4, 0 * X, X, 0.04, 0.05), (CYLINDERS, 0.4, 0.05 * Y, Y, 0.04, 0.05)],
        "thigh": [(TUBES, 0.3, 0 * X, -0.21 * Z, 0.02), (CYLINDERS, 0.5, -0.02 * Z, Y, 0.04, 0.05)],
        "shank": [(TUBES, 0.16, 0 * X, -0.2 * Z, 0.012), (BALLS, 0.06, -0.2 * Z, 0.02)],
    },
    "linkage/linkage.xml": {
        "turret": [
            (CYLINDERS, 0.8, 0.02 * Z, Z, 0.06, 0.05),
            (CYLINDERS, 0.5, 0.05 * Z, Y, 0.035, 0.08),
        ],
        "lower_arm": [(TUBES, 0.3, 0 * X, 0.2 * Z, 0.015)],
        "forearm": [
            (TUBES, 0.3, -0.05 * X, 0.18 * X, 0.012),
            (CYLINDERS, 0.15, 0.18 * X, Y, 0.018, 0.04),
        ],
        "tool": [(BOXES, 0.2, 0.04 * X, (0.08, 0.06, 0.02))],
        "crank": [(TUBES, 0.2, 0 * X, -0.05 * X, 0.012)],
        "rod": [(TUBES, 0.2, 0 * X, 0.2 * Z, 0.006)],
    },
}


def points(kind, *shape, rng):
    """(n, 3) random points of a part, as dense everywhere."""
    n = 200_000
    if kind == BOXES:
        place, size = shape
        return place + rng.uniform(-0.5, 0.5, (n, 3)) * size
    if kind == BALLS:
        place, radius = shape
        ways = rng.normal(size=(n, 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        return place + radius * np.cbrt(rng.uniform(size=(n, 1))) * ways
    if kind == TUBES:
        start, end, radius = shape
        place, axis, length = (start + end) / 2, (end - start), np.linalg.norm(end - start)
        axis, away = axis / length, np.full((n, 1), radius)
    else:
        place, axis, radius, length = shape
        away = radius * np.sqrt(rng.uniform(size=(n, 1)))
    one = np.cross(axis, [axis[2], axis[0], axis[1]])
    turn = rng.uniform(0, 2 * np.pi, (n, 1))
    round_it = np.cos(turn) * one + np.sin(turn) * np.cross(axis, one)
    return place + length * rng.uniform(-0.5, 0.5, (n, 1)) * axis + away * round_it


@pytest.mark.parametrize("name", PARTS)
def test_bodies_have_the_inertia_of_random_points_of_their_parts(name):
    model = mujoco.MjModel.from_xml_path(str(shipped(f"models/{name}")))
    rng = np.random.default_rng(1)
    assert model.nbody == 1 + len(PARTS[name])
    for body, parts in PARTS[name].items():
        clouds = [points(kind, *shape, rng=rng) for kind, _, *shape in parts]
        weights = np.concatenate(
            [
                np.full(len(cloud), part[1] / len(cloud))
                for cloud, part in zip(clouds, parts, strict=True)
            ]
        )
        where = np.concatenate(clouds)
        mass, centre = weights.sum(), np.average(where, axis=0, weights=weights)
        off = where - centre
        inertia = (weights @ (off**2).sum(axis=1)) * np.eye(3) - (off * weights[:, None]).T @ off
        found = model.body(body)
        assert found.mass[0] == pytest.approx(mass)
        assert found.ipos == pytest.approx(centre, abs=2e-4)
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, found.iquat)
        turn = turn.reshape(3, 3)
        whole = turn @ np.diag(found.inertia) @ turn.T
        assert whole == pytest.approx(inertia, abs=0.01 * np.trace(inertia))


@pytest.mark.parametrize("name", ["arm", "leg", "linkage"])
def test_a_robot_comes_with_a_page_and_a_licence(name):
    folder = shipped(f"models/{name}")
    assert (folder / "LICENSE").read_text() == shipped("LICENSE").read_text()
    page = (folder / "README.md").read_text()
    model = mujoco.MjModel.from_xml_path(str(folder / f"{name}.xml"))
    for kind in ("joint", "body"):
        count = {"joint": model.njnt, "body": model.nbody}[kind]
        names = [getattr(model, kind)(k).name for k in range(count)]
        assert [one for one in names if one != "world" and f"`{one}`" not in page] == []


def test_the_arm_is_driven_against_its_weight_and_the_loop_of_the_linkage_stays_closed():
    for name in PARTS:
        model = mujoco.MjModel.from_xml_path(str(shipped(f"models/{name}")))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        most = np.zeros(model.nv)
        for k in range(model.nu):
            limit = model.actuator_forcerange[k, 1] or model.actuator_ctrlrange[k, 1]
            most[model.actuator_trnid[k, 0]] = limit * model.actuator_gear[k, 0]
        driven = most > 0
        assert (np.abs(data.qfrc_bias) < most)[driven].all()
        worst, turn = 0.0, np.arange(1, model.nu + 1)
        for k in range(2000):
            data.ctrl = 0.6 * model.actuator_ctrlrange[:, 1] * np.sin(0.9e-3 * k * turn)
            mujoco.mj_step(model, data)
            worst = max(worst, *np.abs(data.efc_pos[: 3 * model.neq]), 0.0)
        assert worst < 3e-5
        assert not data.warning.number.any()
