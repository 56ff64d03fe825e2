"""A twin as URDF: a body on a joint with damping and dry friction.

Elements and units are those of the wiki pages urdf/XML/link and urdf/XML/joint of ROS: ``dynamics``
has damping in N m s/rad and friction in N m, ``limit`` effort in N m and velocity in rad/s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from butterfly.plant.robot import Shape
from butterfly.twin.forms import Options, xml_comment
from butterfly.twin.plain import accuracy, effort_text, late_steps, left_out, steps_text
from butterfly.twin.twin import Twin, Written

_BEYOND = 1e6  # of effort, velocity or way, where no limit is known and URDF wants one


def as_urdf(twin: Twin, options: Options) -> Written:
    """Return a twin as URDF, with what URDF cannot say in comments."""
    error = accuracy(twin, options)
    missing = tuple(_missing(twin, options))
    notes = (
        f"{twin.name}, as identified.",
        *twin.zero_lines,
        *missing,
        "In MuJoCo, driven this way:",
        *error.lines,
    )
    comments = "\n  ".join(map(xml_comment, notes))
    slides, p, name = twin.built[0].shape is Shape.SLIDE, twin.loaded, twin.identifier
    kind, own, axis = (
        ("prismatic", "slide", "1 0 0") if slides else ("continuous", "hinge", "0 -1 0")
    )
    mass, beside, below, inertia = twin.body
    text = f"""<?xml version="1.0"?>
<robot name="{name}">
  {comments}
  <link name="base"/>
  <link name="{name}">
    <inertial>
      <origin xyz="{beside!r} 0 {-below!r}"/>
      <mass value="{mass!r}"/>
      <inertia ixx="{inertia!r}" iyy="{inertia!r}" izz="{inertia!r}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="{own}" type="{kind}">
    <parent link="base"/>
    <child link="{name}"/>
    <origin xyz="0 0 0" rpy="{0.0 - p.tilt!r} 0 0"/>
    <axis xyz="{axis}"/>
    <dynamics damping="{p.p2!r}" friction="{p.coulomb!r}"/>{_limit(twin)}
  </joint>
</robot>
"""
    about = f"URDF of {kind} joint {own!r}, link {name!r}"
    return Written(text=text, about=about, left_out=missing, accuracy=error)


def _missing(twin: Twin, options: Options) -> Iterator[str]:
    """Name what URDF cannot represent."""
    yield effort_text(twin)
    if late_steps(twin, options):
        late = steps_text(twin, options)
        delay = f"{1e3 * twin.parameters.delay:.3g} ms"
        yield f"Delay each effort yourself by {late} (delay {delay})."
    if twin.servo is not None:
        yield f"The servo's loop ({twin.servo.law}) is not included: the command is its drive's."
    if twin.loaded.p2 or twin.loaded.coulomb:
        yield "Importers may drop damping and friction (Isaac Sim 6.1.0, IsaacSim#841): check both."
    yield from left_out(twin, "URDF")


def _limit(twin: Twin) -> str:
    """Return the limits of torque and speed, if any is known; a slide has to have some."""
    p, slides = twin.parameters, twin.built[0].shape is Shape.SLIDE
    if not slides and not math.isfinite(twin.limit):
        return ""
    effort = abs(p.p4) * twin.limit
    velocity = effort / p.back_emf if p.back_emf else math.inf
    ends = f'lower="{-_BEYOND!r}" upper="{_BEYOND!r}" ' if slides else ""
    most = f'effort="{min(effort, _BEYOND)!r}" velocity="{min(velocity, _BEYOND)!r}"'
    return f"\n    <limit {ends}{most}/>"
