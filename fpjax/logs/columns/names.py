"""A table of the names that drives, robots and people give to the columns of a log, so that most need no --columns.

A name from the table is a guess: the reader says which column it took for which quantity, and --columns overrides it.
Sources of the names: ODrive (pos_estimate, Iq_setpoint), Universal Robots' RTDE (actual_q_0, target_moment_0),
Dynamixel and Rhoban's bam (present_position, load), Kollmorgen (IL.CMD), WPILib and Phoenix (appliedVolts,
rotorPosition), ROS joint states (effort), German, French, Spanish and Italian drive software, and the letters of
textbooks.
"""

import re
import unicodedata
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from .units import QUANTITIES, find_unit, suffix_unit

MOTIONS, TORQUES = ("position", "velocity"), ("torque", "torque_measured")

# Each line is a rank: names in an earlier line are preferred. "name:unit" gives the unit that its source always uses.
# The last line of velocity, position, reference and torque has ambiguous words, taken only where nothing else is.
_COMMANDED = """
tau_cmd torque_cmd cmd_torque torque_command commanded_torque torque_setpoint target_torque torque_target tau_target
desired_torque torque_desired tau_des tau_desired tau_ref torque_ref torque_reference torque_demand sollmoment
drehmoment_soll soll_drehmoment moment_soll m_soll target_moment effort_command command_effort goal_torque torque_des
motor_torque_command tau_command
torque tau drehmoment moment couple par coppia force kraft u control control_torque joint_torque_command
control_input controller_output control_output u_control
iq_setpoint:A iq_ref:A iq_cmd:A iq_command:A iq_target:A iq_des:A current_setpoint:A target_current:A curr_cmd:A
current_command:A commanded_current:A current_cmd:A goal_current:A strom_soll:A sollstrom:A i_soll:A current_ref:A
vir:V voltage:V motor_voltage:V applied_volts:V applied_voltage:V volts:V spannung:V output_voltage:V voltage_cmd:V
pwm:PWM duty:PWM duty_cycle:PWM goal_pwm:PWM present_pwm:PWM pwm_duty:PWM
il_cmd:A
cmd command motor_command
"""
_MEASURED = """
torque_measured measured_torque tau_meas tau_measured torque_meas torque_actual actual_torque torque_estimate
estimated_torque tau_est istmoment drehmoment_ist ist_drehmoment m_ist actual_moment joint_torque tau_act torque_act
torque_feedback tau_feedback tau_m tau_a
effort torque_sensor tau_sensor torque_value output_torque motor_torque motor_measured_torque act_torque
iq:A iq_measured:A iq_meas:A iq_actual:A iq_act:A i_q:A current:A actual_current:A current_actual:A current_measured:A
motor_current:A strom:A iststrom:A strom_ist:A i_ist:A stator_current:A torque_current:A present_current:A
phase_current:A motor_measured_current:A current_feedback:A output_current:A
il_fb:A
load:% present_load:%
"""
_TABLE = {
    "time": """
time t zeit temps tiempo tempo time_s zeitstempel timestamp time_stamp stamp times seconds elapsed elapsed_time clock
pc_ts robot_time controller_time time_since_start rel_time loop_time pi_time log_time sample_time t_now x_value
ms:ms millis:ms milliseconds:ms us:us micros:us ms_today:ms
x_axis
""",
    "velocity": """
velocity velocity_actual actual_velocity velocity_measured measured_velocity vel angular_velocity joint_velocity
joint_vel motor_vel measured_vel omega_m w_m dq_m
motor_velocity rotor_velocity encoder_velocity velocity_act vel_meas vel_actual output_velocity act_vel act_velocity
actual_qd qd dq qdot q_dot theta_dot thetadot dtheta omega winkelgeschwindigkeit geschwindigkeit vitesse velocidad
velocita vel_estimate:rev/s drehzahl:rpm istdrehzahl:rpm drehzahl_ist:rpm ist_drehzahl:rpm n_ist:rpm rpm:rpm
motor_rpm:rpm
speed motor_speed speed_actual actual_speed present_velocity present_speed output_speed measured_speed
motor_measured_speed motor_measured_velocity servo_motor_speed:rpm
vl_fb
w v gyro_z gyroz gyro rate
""",
    "position": """
position position_actual actual_position position_measured measured_position pos joint_position motor_position
rotor_position encoder_position position_act pos_actual pos_meas joint_angle motor_angle output_angle output_position
motor_measured_position act_pos act_position joint_pos motor_pos measured_pos theta_m phi_m q_m
actual_q q qm theta angle winkel drehwinkel istlage lage istposition position_ist lage_ist posizione posicion
pos_estimate:rev encoder_angle present_position angle_actual
pl_fb
encoder enc encoder_count:counts encoder_counts:counts encoder_ticks:counts shadow_count:counts ticks:counts phi
p x weg
""",
    "reference": """
reference velocity_reference position_reference velocity_ref position_ref reference_velocity reference_position
ref setpoint velocity_setpoint position_setpoint target_qd target_q target_velocity target_position velocity_command
position_command vel_cmd pos_cmd velocity_cmd position_cmd desired_velocity desired_position set_velocity set_position
vel_setpoint:rev/s pos_setpoint:rev input_vel:rev/s input_pos:rev goal_position goal_velocity
sollwert solldrehzahl:rpm drehzahl_soll:rpm n_soll:rpm sollposition lage_soll sollgeschwindigkeit consigne
qg q_des q_ref qd_ref qd_des q_desired qd_desired w_ref omega_ref joint_pos_target joint_pos_des joint_vel_target
joint_vel_des pos_target vel_target pos_des vel_des vl_cmd pl_cmd
target desired goal r
""",
    "temperature": """
temperature:degC motor_temperature:degC temp:degC motor_temp:degC winding_temperature:degC temperatur:degC
present_temperature:degC fet_temp:degC fet_temperature:degC
""",
    "torque": _COMMANDED,
    "torque_measured": _MEASURED,
}  # fmt: skip


class KnownName(NamedTuple):
    """Quantity, rank (line of the table) and unit of a name in the table."""

    canonical: str
    rank: int
    unit: str


def _table() -> dict[str, KnownName]:
    found: dict[str, KnownName] = {}
    for canonical, text in _TABLE.items():
        for rank, line in enumerate(text.strip().splitlines()):
            for word in line.split():
                name, _, unit = word.partition(":")
                found.setdefault(name, KnownName(canonical, rank, unit))
                # a linear axis has a force where a rotary one has a torque; a force sensor measures something else
                if "torque" in name and "sensor" not in name:
                    found.setdefault(name.replace("torque", "force"), KnownName(canonical, rank, unit))
    return found


KNOWN = _table()
# Names made of one quantity, who says it (the command, the measurement) and words that change neither: "Actual Motor
# Velocity", "Drehzahlistwert geglättet". One word that is none of these ("error", "limit", "max") and nothing is known.
_WORDS = {
    "velocity": "velocity vel velo speed drehzahl geschwindigkeit rpm",
    "position": "position positions pos lage winkel",
    "torque": "torque tau trq drehmoment moment effort",
    "current": "current curr strom iq",
    "measured": "actual act measured meas feedback fb fbk ist present estimated est monitor",
    "commanded": """command commands commanded cmd target desired des demand setpoint set reference ref soll goal
        control controller""",
    "": """motor servo drive axis joint rotor shaft encoder enc value wert filtered smoothed geglaettet glatt avg
        average mean of now""",
}
_MEANS = {word: kind for kind, text in _WORDS.items() for word in text.split()}
_QUANTITIES = ("velocity", "position", "torque", "current")
# a part of a machine is not called so: these are other quantities of it
_OTHER_WORDS = {
    "max", "min", "limit", "error", "err", "rated", "nominal", "peak", "ff", "ffw", "feedforward", "offset", "bias",
    "std", "delta", "diff",
}  # fmt: skip
_OBJECT = r"(?:0x)?(?=[0-9a-f]*\d)[0-9a-f]{4}h?(?:[:.](?:0x)?[0-9a-f]{1,2}h?)?"  # of CANopen: 6077h, 0x606C:00
# the rank of the last line, with the ambiguous words
WEAK = {
    name: len(_TABLE[name].strip().splitlines()) - 1
    for name in ("velocity", "position", "reference", "torque", "torque_measured")
}
# "velocity [deg/s]", "Drehmoment (mNm)"
_BRACKETED = re.compile(r"^\s*(?P<name>[^\[\](]+?)\s*[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]\s*$")
# "actual_q_0", "tau[2]", "speed (5)": the number of an axis at the end, but not the digits of a longer number
_INDEXED = re.compile(r"^(?P<name>.*?[^0-9_.\[(])[_.\[(]?(?P<index>\d{1,2})[\])]?$")
# "ODrive 2 Position", "motor0_vel", "joint_3_torque", "a1 velocity": the axis stands first
_OWNED = re.compile(
    r"^(?:odrive|odrv|axis|motor|joint|servo|drive|actuator|[a-z])_?(?P<index>\d{1,2})_(?P<name>[a-z].*)$"
)
# "X_ActualPosition", "Z_CurrentFeedback" of machine tools: axes 1 to 6
_LETTERED = re.compile(r"^(?P<letter>[xyzabc])_(?P<name>[a-z].*)$")
# "arm_1_joint_effort", "left_hip_joint_position": ROS' name of a joint, then the quantity
_JOINT = re.compile(r"^(?P<owner>.+_joint)_(?P<name>[a-z].*)$")
_OWNER = re.compile(r"(?:odrv|axis|motor|joint|servo|drive|actuator)[_ ]?(?P<index>\d{1,2})[./:|]", re.IGNORECASE)
_ODRIVE = {"position": "pos_estimate", "velocity": "vel_estimate", "current": "iq_measured"}  # turns, turns/s, A
_VENDORS = ("dxl_", "dynamixel_", "odrive_", "moteus_", "vesc_")
_GREEK = {"θ": "theta", "ϑ": "theta", "φ": "phi", "ϕ": "phi", "ω": "omega", "τ": "tau"}


class Named(NamedTuple):
    """A column's name taken apart.

    Attributes:
        column: name as the file has it.
        plain: in lower case, without unit and axis, words joined by "_".
        unit: unit in the name, in brackets or as an ending; "" without.
        axis: number of the axis in the name; None without.
        owner: what stands before the last part ("knee" of "knee.torque"); "" without.
    """

    column: str
    plain: str
    unit: str
    axis: int | None
    owner: str = ""


def bracket_unit(name: str) -> tuple[str, str | None]:
    """(name without the unit, unit) of "velocity [deg/s]" or "Drehmoment (mNm)"; (name, None) without a unit.

    A number in brackets is an axis ("speed (5)"), the t of "θ(t)" an argument and the 6077h of "torque (6077h)" the
    number of an object: none is a unit.
    """
    found = _BRACKETED.match(name)
    if found and re.fullmatch(_OBJECT, found["unit"], re.IGNORECASE):
        return found["name"], None
    if not found or found["unit"].isdigit():
        return name, None
    return found["name"], None if found["unit"] == "t" else found["unit"]


def taken_apart(column: str) -> list[Named]:
    """All ways to take a name apart, the most literal first: whole, last part, without unit, axis or vendor."""
    text, unit = bracket_unit(column)
    found: list[Named] = []
    owner = _OWNER.search(text)
    # "axis0.encoder.pos_estimate", "/joint_states.velocity.0", "log/Torque"
    # the only field of ROS' std_msgs says nothing, but its topic does: "/effort_control/data.0"
    whole = re.sub(r"(?<=\w)(?:[./](commands?))?[./]data(?=$|[.\[]\d)", r"_\1", text)
    whole = re.sub(r"[./:|](\d{1,2})$", r"_\1", whole)
    tail = re.split(r"[./:|]", whole)[-1]
    for part in dict.fromkeys([text, tail]):
        start = len(found)
        plain = _snake(part)
        found.append(Named(column, plain, unit or "", int(owner["index"]) if owner and part == tail else None))
        ending = None if unit else suffix_unit(plain)
        if ending:
            found.append(Named(column, ending[0], ending[1], None))
        for name in (plain, *([ending[0]] if ending else [])):
            indexed = _INDEXED.match(name)
            if indexed:
                stem = indexed["name"].rstrip("_")
                found.append(Named(column, stem, unit or (ending[1] if ending else ""), int(indexed["index"])))
                if (plainer := re.sub(r"_(?:m|j|motor|axis|joint|servo)$", "", stem)) != stem:  # "CURRENT_M1"
                    found.append(found[-1]._replace(plain=plainer))
                inner = None if unit or ending else suffix_unit(stem)
                if inner:
                    found.append(Named(column, inner[0], inner[1], int(indexed["index"])))
        owned = _OWNED.match(plain)
        if owned:
            inner = None if unit else suffix_unit(owned["name"])
            word = owned["name"] if unit or not plain.startswith("od") else _ODRIVE.get(owned["name"], owned["name"])
            found.append(Named(column, word, unit or "", int(owned["index"])))
            found += [Named(column, *inner, int(owned["index"]))] if inner else []
        lettered = _LETTERED.match(plain)
        if lettered:
            found.append(Named(column, lettered["name"], unit or "", "xyzabc".index(lettered["letter"]) + 1))
        found += [
            Named(column, plain.removeprefix(vendor), unit or "", None)
            for vendor in _VENDORS
            if plain.startswith(vendor)
        ]
        joint = _JOINT.match(plain)
        if joint:
            found.append(Named(column, joint["name"], unit or "", None, joint["owner"]))
        if part == tail and tail != text:
            before = whole[: len(whole) - len(tail)].rstrip("./:|")
            found[start:] = [each._replace(owner=each.owner or before) for each in found[start:]]
    return found


def _snake(text: str) -> str:
    text = text.strip().translate(str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "Ä": "Ae", "Ö": "Oe"}))
    text = "".join(_GREEK.get(c, c) for c in text)
    text = "".join(c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
    # a unit is no camel case: "torque_mNm" would be a "torque_m" in newton metres
    text = re.sub(r"(?<![A-Za-z])[mkuµ](?:Nm?|A|V)(?![A-Za-z])", lambda unit: unit[0].lower(), text)
    # camel case to words: "pos_estimate" and "posEstimate" are one name
    text = re.sub(r"([a-z])([A-Z])", r"\1_\2", text)
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")


class Guess(NamedTuple):
    """A column whose name is in the table.

    Attributes:
        column: name in the file.
        unit: from the name, a row of units or the table; "" for SI.
        rank: line of the table: the smaller, the surer.
        axis: number of the axis in the name; None without.
        owner: what stands before the last part of the name; "" without.
    """

    column: str
    unit: str
    rank: int
    axis: int | None
    owner: str = ""


def guess(names: Iterable[str], units: Mapping[str, str]) -> dict[str, list[Guess]]:
    """For each canonical column, the file's columns that the table knows as it, the surest first.

    Args:
        names: the file's columns.
        units: units from a row of units, by column name.
    """
    found: dict[str, list[Guess]] = {}
    names = list(names)
    for column in names:
        parts = taken_apart(column)
        for named, known in [(each, KNOWN.get(each.plain)) for each in parts] + [(each, _made(each)) for each in parts]:
            if known is not None:
                unit = named.unit or units.get(column, "") or known.unit
                if not _possible(unit, known.canonical):
                    continue
                found.setdefault(known.canonical, []).append(Guess(column, unit, known.rank, named.axis, named.owner))
                break
    if not set(found) & {*MOTIONS, *TORQUES}:
        for canonical, each in _of_parts(names, units):
            found.setdefault(canonical, []).append(each)
    return {canonical: sorted(guesses, key=lambda each: each.rank) for canonical, guesses in found.items()}


def _of_parts(names: list[str], units: Mapping[str, str]) -> list[tuple[str, Guess]]:
    """(quantity, column) of names such as "left_knee_torque": of parts that have a motion and a torque by that name."""
    parts: dict[str, list[tuple[str, Guess]]] = {}
    for column in names:
        for named in taken_apart(column):
            words = named.plain.split("_")
            ends = [(cut, named._replace(plain="_".join(words[cut:]))) for cut in range(1, len(words))]
            known = [(cut, KNOWN.get(end.plain) or _made(end)) for cut, end in ends]
            cut, what = next(((cut, what) for cut, what in known if what is not None), (0, None))
            if what is None or set(words[:cut]) & _OTHER_WORDS or what.rank >= WEAK.get(what.canonical, 99):
                continue
            unit, part = named.unit or units.get(column, "") or what.unit, "_".join(words[:cut])
            if _possible(unit, what.canonical):
                parts.setdefault(part, []).append((what.canonical, Guess(column, unit, what.rank, named.axis, part)))
                break
    whole = [each for each in parts.values() if all({c for c, _ in each} & set(need) for need in (MOTIONS, TORQUES))]
    return [one for each in whole for one in each]


def _made(named: Named) -> KnownName | None:
    """What a name says that is made of known words only: one quantity, and whether it is a command."""
    # "drehzahlistwert", "sollposition": German writes them as one word
    plain = re.sub(r"(ist|soll)(wert)?(?=_|$)", r"_\1", re.sub(r"(^|_)(ist|soll)(?=[a-z])", r"\1\2_", named.plain))
    words = [word for word in plain.split("_") if word and not re.fullmatch(_OBJECT, word)]
    means = [_MEANS.get(word) for word in words]
    said = [each for each in means if each in _QUANTITIES]
    if len(said) == 2 and said[0] == words[0] == "current":  # "current position" is the present one
        said, means = said[1:], ["measured", *means[1:]]
    if len(said) != 1 or None in means or {"measured", "commanded"} <= set(means):
        return None
    (quantity,) = said
    # as sure as a name of the table that says the same
    if quantity in MOTIONS:
        like = "reference" if "commanded" in means else quantity
    elif quantity == "torque":
        like = "effort" if "measured" in means else "torque"
    else:
        like = "current_cmd" if "commanded" in means else "current"
    # a rotational speed by its word
    unit = "rpm" if {"drehzahl", "rpm"} & set(words) else KNOWN[like].unit
    return KNOWN[like]._replace(unit=unit)


def _possible(unit: str, canonical: str) -> bool:
    """Whether a quantity can have this unit: an encoder's volts are no position. An unknown unit is asked for later."""
    known = find_unit(unit) if unit else None
    rotary, linear = QUANTITIES[canonical]
    return known is None or known.quantity in (*rotary, *linear)
