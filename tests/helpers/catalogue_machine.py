"""The machine's blocks: friction, loads, plants, actuators, sensors."""

import jax
import jax.numpy as jnp
import numpy as np
from catalogue_case import DT, VELOCITIES, Case, controller, remembered, smooth_body

import fpjax as fp
from fpjax.blocks.friction.bristles import Bristles
from fpjax.blocks.friction.general import GeneralFriction
from fpjax.blocks.plants.transmission import Transmission
from fpjax.blocks.position_torque import ConstantTorque, Loads, PositionTorque
from fpjax.blocks.servo_sensor import ServoSensor

# Friction ----------------------------------------------------------------------------------------------------------


def evaluate_friction(law, at):
    motion = fp.Motion(at["velocity"], at["position"], at["time"], at["applied"])
    state = jax.tree.map(lambda leaf: leaf + at["memory"].astype(leaf.dtype), law.init())
    return law.init(), law.derivative(state, motion), law.readout(state, motion, at["applied"])


def general():
    """Every term of `GeneralFriction` at once."""
    cosine, sine = (jnp.asarray(1.0), jnp.asarray(0.3)), (jnp.asarray(-0.5), jnp.asarray(0.2))
    return GeneralFriction(20.0, 2.0, 2.0, 0.3, 5.0, 0.05, 2.0, cosine, sine, 3.0, 1.0, 0.5, 0.4, steepness=40.0)


def friction_case(name, build, velocity=0.1, memory=1.0):
    return Case(
        "friction",
        name,
        build,
        evaluate_friction,
        {"velocity": velocity, "position": 1.0, "time": 1.0, "memory": memory, "applied": 10.0},
        VELOCITIES,
        lambda law: (fp.ClosedLoop(fp.OneMass(10.0, law), controller()), fp.Sine(1.0, 20.0, 0.4)),
    )


FRICTION = [
    friction_case("none", fp.NoFriction),
    friction_case("coulomb", lambda: fp.Coulomb(20.0)),
    friction_case("smooth_coulomb", lambda: fp.SmoothCoulomb(20.0, 40.0), 1 / 40.0),
    friction_case("smooth_coulomb_steep", lambda: fp.SmoothCoulomb(2.0, 4000.0), 1 / 4000.0),
    friction_case("viscous", lambda: fp.Viscous(2.0)),
    friction_case("coulomb_viscous_sign", lambda: fp.CoulombViscous(20.0, 2.0)),
    friction_case("coulomb_viscous", lambda: fp.CoulombViscous(20.0, 2.0, 40.0), 1 / 40.0),
    friction_case("stiction_sign", lambda: fp.CoulombViscousStiction(20.0, 25.0, 2.0, 0.01)),
    friction_case("stiction", lambda: fp.CoulombViscousStiction(20.0, 25.0, 2.0, 0.005, 40.0), 1 / 40.0),
    friction_case("stribeck_sign", lambda: fp.Stribeck(20.0, 25.0, 0.05, 2.0), 0.05),
    friction_case("stribeck_gauss", lambda: fp.Stribeck(20.0, 25.0, 0.05, 2.0, 2.0, 40.0), 1 / 40.0),
    friction_case("stribeck_tustin", lambda: fp.Stribeck(20.0, 25.0, 0.05, 2.0, 1.0, 40.0), 1 / 40.0),
    friction_case("stribeck_half", lambda: fp.Stribeck(20.0, 25.0, 0.05, 2.0, 0.5, 40.0), 1 / 40.0),
    friction_case("dahl", lambda: fp.Dahl(20.0, 2000.0, 1.0, 2.0), 0.01, 6.0),
    friction_case("dahl_fractional", lambda: fp.Dahl(20.0, 2000.0, 1.5, 2.0), 0.01, 6.0),
    friction_case("lugre", lambda: fp.LuGre(20.0, 25.0, 0.05, 20000.0, 1000.0, 2.0), 0.05, 1e-3),
    friction_case("lugre_fractional", lambda: fp.LuGre(20.0, 25.0, 0.05, 2000.0, 100.0, 2.0, 0.5), 0.05, 1e-2),
    friction_case("asymmetric_sign", lambda: fp.AsymmetricCoulombViscous(20.0, 15.0, 2.0, 3.0)),
    friction_case("general_neutral_coulomb_sign", lambda: GeneralFriction(20.0, 2.0)),
    friction_case("general_asymmetric", lambda: general(), 1 / 40.0),
    friction_case("general_load", lambda: GeneralFriction(20.0, 2.0, steepness=40.0, load_coefficient=0.2), 1 / 40.0),
    friction_case("general_load_sign", lambda: GeneralFriction(20.0, 2.0, load_coefficient=0.2)),
    friction_case("bristles_dahl", lambda: Bristles(fp.CoulombViscous(20.0, 2.0), 1e-3, 50.0), 0.01, 0.3),
    friction_case("bristles_dahl_power", lambda: Bristles(fp.CoulombViscous(20.0, 2.0), 1e-2, 0.0, 1.5), 0.01, 0.3),
    friction_case("asymmetric", lambda: fp.AsymmetricCoulombViscous(20.0, 15.0, 2.0, 3.0, 40.0), 1 / 40.0),
]

# Loads -------------------------------------------------------------------------------------------------------------


def evaluate_load(load, at):
    return load.readout(fp.Motion(at["velocity"], at["position"], at["time"], at["torque"]))


def load_case(name, build):
    return Case(
        "load",
        name,
        build,
        evaluate_load,
        {"velocity": 1.0, "position": 1.0, "time": 1.0, "torque": 10.0},
        VELOCITIES,
        lambda load: (
            fp.ClosedLoop(fp.OneMass(10.0, fp.CoulombViscous(20.0, 2.0, 40.0), load), controller()),
            fp.Sine(1.0, 20.0, 0.4),
        ),
    )


def harmonics():
    return PositionTorque((jnp.asarray(1.0), jnp.asarray(0.3)), (jnp.asarray(-0.5), jnp.asarray(0.2)), 3.0)


def learned(of, period=None, interpolation="linear"):
    """Points off the tried ones: a straight line has no derivative where it bends."""
    scale = 10.0 if of == "torque" else 1.0
    return fp.LearnedTorque(
        of, [-1.9 * scale, -0.4 * scale, 0.17 * scale, 2.3 * scale], [-2.0, 1.0, 0.5, 3.0], period, interpolation
    )


LOADS = [
    load_case("none", fp.NoLoad),
    load_case("unbalance", lambda: fp.Unbalance(5.0, 0.3, 1.0)),
    load_case("constant", lambda: ConstantTorque(2.0)),
    load_case("harmonics", harmonics),
    load_case("learned_velocity", lambda: learned("velocity")),
    load_case("learned_velocity_cubic", lambda: learned("velocity", None, "cubic")),
    load_case("learned_position", lambda: learned("position")),
    load_case("learned_position_periodic", lambda: learned("position", 2.0 * np.pi, "cubic")),
    load_case("learned_torque", lambda: learned("torque")),
    load_case("learned_time", lambda: learned("time", 5.0)),
    load_case("sum", lambda: Loads((harmonics(), ConstantTorque(2.0)))),
]

# Plants ------------------------------------------------------------------------------------------------------------


def evaluate_plant(plant, at):
    # Every state other than the bristles' gets the tried velocity in its own proportion.
    leaves, structure = jax.tree.flatten(plant.init())
    shares = (1.0, 0.3, -0.7, 0.2, 0.01, 0.01)
    state = jax.tree.unflatten(structure, [leaf + at["velocity"] * shares[i] for i, leaf in enumerate(leaves)])
    derivative = plant.derivative(state, at["torque"], at["time"])
    return plant.init(), derivative, plant.readout(state, at["torque"], at["time"])


def plant_case(name, build, velocity=1 / 40.0):
    return Case(
        "plant",
        name,
        build,
        evaluate_plant,
        {"velocity": velocity, "torque": 10.0, "time": 1.0},
        VELOCITIES,
        lambda plant: (fp.ClosedLoop(plant, controller()), fp.Sine(1.0, 20.0, 0.4)),
    )


def law():
    return fp.CoulombViscous(20.0, 2.0, 40.0)


PLANTS = [
    plant_case("one_mass", lambda: fp.OneMass(10.0, law())),
    plant_case("one_mass_loaded", lambda: fp.OneMass(10.0, law(), fp.Unbalance(5.0, 0.3))),
    plant_case("two_mass", lambda: fp.TwoMass(4.0, 6.0, 1e5, 50.0, law())),
    plant_case("two_mass_lugre", lambda: fp.TwoMass(4.0, 6.0, 1e5, 50.0, fp.LuGre(20.0, 25.0, 0.05, 2000.0, 100.0))),
    plant_case("transmission", lambda: Transmission(10.0, 0.6, 1e5, 50.0, law(), 1e-4, 0.7)),
    plant_case("series_two_mass", lambda: fp.SeriesTwoMass(4.0, 6.0, 1e5, 50.0, law())),
]

# Actuators ---------------------------------------------------------------------------------------------------------


def evaluate_actuator(block, at):
    motion = fp.Motion(at["velocity"], at["position"], at["time"])
    state = remembered(block, at["memory"])
    delayed = getattr(block, "delay", None) is not None
    derivative = () if delayed else block.derivative(state, at["torque"])
    stepped = block.step(state, at["torque"], motion, jnp.asarray(DT, at["velocity"].dtype))
    return block.init(), derivative, block.readout(state, at["torque"], motion), stepped


def actuator_case(name, build, stepping="sampled"):
    return Case(
        "actuator",
        name,
        build,
        evaluate_actuator,
        {"velocity": 1.0, "position": 1.0, "time": 1.0, "memory": 3.0, "torque": 10.0},
        ({"torque": 0.0}, {"torque": 0.41}, {"torque": -2.3}, {"torque": 9.0}),
        lambda block: (fp.ClosedLoop(smooth_body(), controller(), actuator=block), fp.Sine(1.0, 20.0, 0.4)),
        stepping,
    )


ACTUATORS = [
    actuator_case("ideal", fp.IdealActuator, "continuous"),
    actuator_case("gain_offset", lambda: fp.Actuator(gain=0.9, offset=0.5), "continuous"),
    actuator_case("lag", lambda: fp.Actuator(lag=2e-3), "continuous"),
    actuator_case("lag_sampled", lambda: fp.Actuator(lag=2e-3)),
    actuator_case("delay", lambda: fp.Actuator(delay=1.4e-3)),
    actuator_case("limit", lambda: fp.Actuator(limit=40.0)),
    actuator_case("dead_zone", lambda: fp.Actuator(dead_zone=2.0)),
    actuator_case(
        "cogging", lambda: fp.Actuator(cogging_amplitude=2.0, cogging_periods=7.0, cogging_phase=0.3), "continuous"
    ),
    actuator_case(
        "all",
        lambda: fp.Actuator(0.9, 2e-3, 1.4e-3, 60.0, 0.5, 0.3, 1.0, 7.0, 0.2, longest_delay=4),
    ),
]

# Sensors -----------------------------------------------------------------------------------------------------------


def evaluate_sensor(block, at):
    output = fp.PlantOutput(
        at["velocity"], at["position"], 1.1 * at["velocity"], 1.2 * at["position"], jnp.zeros_like(at["velocity"])
    )
    state = remembered(block, at["memory"])
    noise = tuple(at["noise"] * (1.0 + 0.3 * i) for i in range(block.noise_channels))
    stepped = block.step(state, output, noise, jnp.asarray(DT, at["velocity"].dtype))
    shown = block.readout(output) if isinstance(block, fp.IdealSensor) else ()
    return block.init(), stepped, shown


def sensor_case(name, build, stepping="sampled", rough=False, jumps=()):
    return Case(
        "sensor",
        name,
        build,
        evaluate_sensor,
        {"velocity": 1.0, "position": 1.0, "memory": 0.1, "noise": 1.0},
        VELOCITIES,
        lambda block: (fp.ClosedLoop(smooth_body(), controller(), sensor=block), fp.Sine(1.0, 20.0, 0.4)),
        stepping,
        rough,
        jumps,
    )


def fusion(step=0.0):
    return fp.KalmanFusion(fp.Gyro(1e-2, 0.05, 1e-2), fp.Encoder(step, 1e-4, 2e-3), 1e-3)


SENSORS = [
    sensor_case("ideal", fp.IdealSensor, "continuous"),
    sensor_case("ideal_motor", lambda: fp.IdealSensor("motor"), "continuous"),
    sensor_case("gyro", lambda: fp.Gyro(1e-2, 0.05, 1e-2, 1.01)),
    sensor_case("encoder", lambda: fp.Encoder(0.0, 1e-4, 2e-3), jumps=("step_size",)),
    sensor_case("encoder_quantised", lambda: fp.Encoder(1e-3, 0.0, 2e-3), rough=True),
    sensor_case(
        "servo",
        lambda: ServoSensor(0.7, 1.01, 0.05, 2e-3, 1.4e-3, 1e-2, longest_delay=3),
        jumps=("step_size", "position_step"),
    ),
    sensor_case("servo_quantised", lambda: ServoSensor(step_size=1e-3, position_step=1e-4, lag=1e-3), rough=True),
    sensor_case("kalman", fusion, jumps=("encoder.step_size",)),
    sensor_case("kalman_quantised", lambda: fusion(1e-3), rough=True),
]
