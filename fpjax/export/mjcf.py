"""A body as MJCF (MuJoCo) and as URDF: the text, and the effects that each format leaves out."""

import math
from typing import Any
from xml.sax.saxutils import quoteattr

from .body import Body, Leftover, Wave, without_actuator_field, without_offset, without_waves

GRAVITY = 9.81  # [m/s^2]
TINY = 1e-9  # share of the inertia given to the bodies: MuJoCo requires a positive one; the armature has the rest


def mjcf(body: Body, *, name: str, linear: bool, timestep: float, dcmotor: bool, delays: bool) -> str:
    """The MJCF text of a body; effects that it cannot express are added to `body.leftovers`.

    Each mass has one joint, attached to the world. The shaft between them is a tendon, whose spring has a dead band
    (the backlash). An unbalance is an eccentric mass under gravity. Torques that repeat with the position, and LuGre
    friction, are actuators of type dcmotor with a negligible motor constant.

    Args:
        body: from `body_of`.
        name: name of the model.
        linear: slide joints instead of hinges.
        timestep: MuJoCo's step [s].
        dcmotor: whether this version of MuJoCo has the dcmotor actuator.
        delays: whether its actuators have a delay.
    """
    sides = ("motor", "load") if body.shaft else ("axis",)
    friction_on = len(sides) - 1
    pendulum = _pendulum(body, linear)
    waves = [(sides[0], wave) for wave in body.waves]
    waves += [(sides[-1], wave) for wave in body.load_waves if pendulum is None or wave[1] != 1.0]
    if waves and not dcmotor:
        body.leftovers.append(Leftover("torques that repeat with the position (no dcmotor here)", without_waves))
        waves = []
    if body.delay and not delays:
        body.leftovers.append(Leftover("the actuator's delay", without_actuator_field("delay")))
    bodies = []
    for place, side in enumerate(sides):
        own = pendulum if pendulum is not None and place == len(sides) - 1 else None
        bodies += _mjcf_body(side, body, place, own, linear, timestep)
    actuators = [_motor(body, sides[0], delays)]
    if body.offset:
        bias = f'gaintype="fixed" gainprm="0" biastype="affine" biasprm="{_n(body.offset)} 0 0"'
        actuators.append(f'<general name="offset" joint="{sides[0]}" {bias}/>')
    nothing = 'motorconst="1e-9" resistance="1"'
    for number, (side, (size, periods, phase)) in enumerate(waves):
        cogging = f'cogging="{_n(size)} {_n(periods)} {_n(phase)}"'
        actuators.append(f'<dcmotor name="wave_{number}" joint="{side}" {nothing} {cogging}/>')
    if body.lugre:
        lugre = " ".join(_n(each) for each in body.lugre)
        actuators.append(f'<dcmotor name="bristles" joint="{sides[friction_on]}" {nothing} lugre="{lugre}"/>')
    tendon = []
    if body.shaft:
        stiffness, damping, gap = body.shaft
        tendon = [
            "  <tendon>",
            f'    <fixed name="shaft" stiffness="{_n(stiffness)}" damping="{_n(damping)}" '
            f'springlength="{_n(-0.5 * gap)} {_n(0.5 * gap)}">',
            '      <joint joint="motor" coef="1"/>',
            '      <joint joint="load" coef="-1"/>',
            "    </fixed>",
            "  </tendon>",
        ]
    gravity = f"0 0 {_n(-GRAVITY if pendulum else 0.0)}"
    return "\n".join(
        [
            f"<mujoco model={quoteattr(name)}>",
            '  <compiler angle="radian" autolimits="true"/>',
            f'  <option timestep="{_n(timestep)}" gravity="{gravity}" integrator="implicitfast" tolerance="1e-12"/>',
            "  <worldbody>",
            *(f"    {line}" for line in bodies),
            "  </worldbody>",
            *tendon,
            "  <actuator>",
            *(f"    {line}" for line in actuators),
            "  </actuator>",
            "</mujoco>\n",
        ]
    )


def urdf(body: Body, *, name: str, linear: bool) -> str:
    """The URDF text of a body, with one joint; effects that it cannot express are added to `body.leftovers`.

    Args:
        body: from `body_of`, with one mass.
        name: name of the robot.
        linear: a prismatic joint instead of a continuous one.
    """
    if body.waves or body.load_waves:
        body.leftovers.append(Leftover("torques that repeat with the position", without_waves))
    if body.offset:
        body.leftovers.append(Leftover("constant torques", without_offset))
    for field, there in (("gain", body.gain != 1.0), ("lag", body.lag > 0.0), ("delay", body.delay > 0.0)):
        if there:
            body.leftovers.append(Leftover(f"the actuator's {field}", without_actuator_field(field)))
    inertia = body.inertia[0]
    # Only one of mass [kg] and moment of inertia [kg m^2] matters; the other must be positive, and negligible.
    mass, turn = (inertia, 1e-6) if linear else (1e-6, inertia)
    same = " ".join(f'{axis}="{_n(turn)}"' for axis in ("ixx", "iyy", "izz"))
    effort = _n(body.limit) if body.limit is not None else "1e9"
    limits = f'effort="{effort}" velocity="1e9"' + (' lower="-1e9" upper="1e9"' if linear else "")
    return "\n".join(
        [
            '<?xml version="1.0"?>',
            f"<robot name={quoteattr(name)}>",
            '  <link name="base"/>',
            '  <link name="axis_link">',
            "    <inertial>",
            f'      <mass value="{_n(mass)}"/>',
            f'      <inertia {same} ixy="0" ixz="0" iyz="0"/>',
            "    </inertial>",
            "  </link>",
            f'  <joint name="axis" type="{"prismatic" if linear else "continuous"}">',
            '    <parent link="base"/>',
            '    <child link="axis_link"/>',
            '    <axis xyz="1 0 0"/>',
            f'    <dynamics damping="{_n(body.viscous[0])}" friction="{_n(body.coulomb[0])}"/>',
            f"    <limit {limits}/>",
            "  </joint>",
            "</robot>\n",
        ]
    )


def _pendulum(body: Body, linear: bool) -> Wave | None:
    """All torques of one period per revolution as one eccentric mass; None without any, and for a slide."""
    once = [wave for wave in body.load_waves if wave[1] == 1.0]
    if linear or not once:
        return None
    # Sines of one period add as complex amplitudes. The sign is turned, because gravity holds back: size below zero.
    total = sum(size * complex(math.cos(phase), math.sin(phase)) for size, _, phase in once)
    return -abs(total), 1.0, math.atan2(-total.imag, -total.real)


def _mjcf_body(side: str, body: Body, place: int, pendulum: Wave | None, linear: bool, timestep: float) -> list[str]:
    inertia = body.inertia[place]
    armature = inertia * (1.0 - TINY)
    # An eccentric mass m at the arm r makes the torque m g r = amplitude. The arm is chosen such that its own moment of
    # inertia m r^2 is a thousandth of the axis', which is taken off the armature.
    mass, position = 1e-3 * inertia if linear else 1e-6, "0 0 0"
    if linear:
        armature = inertia - mass
    if pendulum is not None:
        size, _, phase = pendulum
        arm = 1e-3 * inertia * GRAVITY / abs(size)
        mass = abs(size) / (GRAVITY * arm)
        position = f"0 {_n(arm * math.sin(phase))} {_n(-arm * math.cos(phase))}"
        armature -= mass * arm * arm
    turn = _n(max(TINY * inertia, 1e-14))
    friction = f'frictionloss="{_n(body.coulomb[place])}" damping="{_n(body.viscous[place])}"'
    # Dry friction in MuJoCo is a soft constraint. These make it as hard as the solver allows (a time constant of two
    # steps, an impedance near 1): with the defaults a stuck joint creeps.
    hard = f'solreffriction="{_n(2.0 * timestep)} 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"'
    kind = "slide" if linear else "hinge"
    return [
        f'<body name="{side}_body">',
        f'  <joint name="{side}" type="{kind}" axis="1 0 0" armature="{_n(armature)}" {friction} {hard}/>',
        f'  <inertial pos="{position}" mass="{_n(mass)}" diaginertia="{turn} {turn} {turn}"/>',
        "</body>",
    ]


def _motor(body: Body, joint: str, delays: bool) -> str:
    words = [f'<general name="torque" joint="{joint}" gainprm="{_n(body.gain)}"']
    if body.lag:
        words.append(f'dyntype="filterexact" dynprm="{_n(body.lag)}"')
    if body.limit is not None:
        words.append(f'forcerange="{_n(-body.limit)} {_n(body.limit)}"')
    if body.delay and delays:
        words.append(f'delay="{_n(body.delay)}" nsample="DELAY_SAMPLES"')
    return " ".join(words) + "/>"


def _n(value: Any) -> str:
    return repr(float(value))
