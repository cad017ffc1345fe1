"""The drive's blocks: observers, controllers, references."""

import jax.numpy as jnp
import numpy as np
from catalogue_case import DT, VELOCITIES, Case, controller, remembered, smooth_body

import fpjax as fp

# Observers ---------------------------------------------------------------------------------------------------------


def evaluate_observer(observer, at):
    velocity, control = at["velocity"], at["control"]
    state = remembered(observer, at["memory"])
    parameters = {"coulomb": at["control"], "viscous": at["memory"], "steepness": at["memory"]}
    return (
        observer.init(),
        observer.derivative(state, control, velocity),
        observer.step(state, control, velocity, jnp.asarray(DT, velocity.dtype)),
        observer.readout(state, velocity),
        observer.slopes(velocity),
        observer.regressor(velocity, parameters),
    )


def observer_case(name, build, velocity=1 / 40.0):
    return Case(
        "observer",
        name,
        build,
        evaluate_observer,
        {"velocity": velocity, "control": 10.0, "memory": 5.0},
        VELOCITIES,
        lambda observer: (fp.ClosedLoop(smooth_body(), controller(), observer), fp.Sine(1.0, 20.0, 0.4)),
    )


NONLINEARITIES = {
    "g1": lambda: fp.Quadratic(100.0),
    "g2": lambda: fp.Absolute(10.0),
    "g3": lambda: fp.LogCosh(10.0, 40.0),
}
OBSERVERS = [observer_case("none", fp.NoObserver)]
for _name, _g in NONLINEARITIES.items():
    OBSERVERS += [
        observer_case(f"cfp_{_name}_sign", lambda g=_g: fp.ClassicalFriedlandPark(10.0, g(), 2.0)),
        observer_case(f"cfp_{_name}", lambda g=_g: fp.ClassicalFriedlandPark(10.0, g(), 2.0, 40.0)),
        observer_case(f"mfp_{_name}_sign", lambda g=_g: fp.ModifiedFriedlandPark(10.0, g(), 2.0)),
        observer_case(f"mfp_{_name}", lambda g=_g: fp.ModifiedFriedlandPark(10.0, g(), 2.0, 40.0)),
        observer_case(f"nfp_{_name}_sign", lambda g=_g: fp.NovelFriedlandPark(10.0, g(), 20.0)),
        observer_case(f"nfp_{_name}", lambda g=_g: fp.NovelFriedlandPark(10.0, g(), 20.0, 40.0)),
        observer_case(f"steepness_{_name}", lambda g=_g: fp.SteepnessObserver(10.0, g(), 20.0), 0.2),
    ]
OBSERVERS += [
    observer_case("efp_sign", lambda: fp.ExtendedFriedlandPark(10.0, 298.0, 72.6)),
    observer_case("efp", lambda: fp.ExtendedFriedlandPark(10.0, 298.0, 72.6, 40.0)),
    observer_case("efp_extension_1_sign", lambda: fp.ExtendedSteepnessCoulomb(10.0, 300.0, 10.0, 2.0), 0.2),
    observer_case("efp_extension_1", lambda: fp.ExtendedSteepnessCoulomb(10.0, 300.0, 10.0, 2.0, 40.0), 0.02),
    observer_case("efp_extension_2_sign", lambda: fp.ExtendedSteepnessViscous(10.0, 300.0, 10.0, 20.0), 0.2),
    observer_case("efp_extension_2", lambda: fp.ExtendedSteepnessViscous(10.0, 300.0, 10.0, 20.0, 40.0), 0.02),
    observer_case(
        "high_order",
        lambda: fp.HighOrderFeedforward(fp.ExtendedFriedlandPark(10.0, 298.0, 72.6, 40.0), 4.0, 6.0, 1e5, 50.0),
    ),
]

# Controllers -------------------------------------------------------------------------------------------------------


def evaluate_controller(block, at):
    measurement = fp.Measurement(at["velocity"], at["position"])
    state = remembered(block, at["memory"])
    args = (state, at["reference"], measurement)
    stepped = block.step(*args, jnp.asarray(DT, at["velocity"].dtype))
    return block.init(), block.derivative(*args), block.readout(*args), stepped


def controller_case(name, build, stepping="continuous", reference=None):
    return Case(
        "controller",
        name,
        build,
        evaluate_controller,
        {"velocity": 1.0, "position": 1.0, "reference": 1.0, "memory": 3.0},
        VELOCITIES,
        lambda block: (fp.ClosedLoop(smooth_body(), block), reference or fp.Sine(1.0, 20.0, 0.4)),
        stepping,
    )


CONTROLLERS = [
    controller_case("p", lambda: fp.Proportional(150.0)),
    controller_case("torque_input", fp.TorqueInput),
    controller_case("pi", controller),
    controller_case("pi_limited", lambda: fp.ProportionalIntegral(150.0, 2000.0, 40.0, 0.02)),
    controller_case("pi_sampled", controller, "sampled"),
    controller_case("lead", lambda: fp.Lead(570.0, 217.0, 368.0)),
    controller_case("transfer_function", lambda: fp.TransferFunction([150.0, 2e3, 9.0], [1.0, 60.0, 90.0], period=DT)),
    controller_case(
        "transfer_function_sampled",
        lambda: fp.TransferFunction([150.0, 2e3, 9.0], [1.0, 60.0, 90.0], period=DT),
        "sampled",
    ),
    controller_case("transfer_function_gain", lambda: fp.TransferFunction([150.0], [1.0]), "sampled"),
    controller_case("position_cascade", lambda: fp.PositionLoop(20.0, fp.Proportional(150.0))),
    controller_case("position_pi", lambda: fp.PositionLoop(20.0, controller()), "sampled"),
    controller_case("limited", lambda: fp.Limited(controller(), 40.0)),
    controller_case("feedforward", lambda: fp.Feedforward(controller(), 9.0, 18.0, 1.8, 0.5, 0.02)),
    controller_case("feedforward_sampled", lambda: fp.Feedforward(controller(), 9.0, 18.0, 1.8, 0.5, 0.02), "sampled"),
    controller_case(
        "feedforward_limited",
        lambda: fp.Feedforward(fp.ProportionalIntegral(150.0, 2000.0, 40.0, 0.02), 9.0, 18.0, 1.8, 0.5, 0.02),
    ),
    controller_case(
        "position_feedforward",
        lambda: fp.PositionFeedforward(fp.PositionLoop(20.0, controller()), 0.9, 9.0, 18.0, 1.8, 0.5, 0.02),
    ),
    controller_case(
        "position_feedforward_sampled",
        lambda: fp.PositionFeedforward(
            fp.Limited(fp.PositionLoop(20.0, fp.Proportional(150.0)), 400.0), 0.9, 9.0, 18.0, 1.8, 0.5, 0.02
        ),
        "sampled",
    ),
]

# References --------------------------------------------------------------------------------------------------------


def evaluate_reference(block, at):
    return block.readout(at["time"]), block.readout(at["time"] + jnp.linspace(0.01, 0.02, 3).astype(at["time"].dtype))


def reference_case(name, build):
    return Case(
        "reference",
        name,
        build,
        evaluate_reference,
        {"time": 0.1},
        ({"time": 0.0}, {"time": 0.37}, {"time": 3.3}),
        lambda block: (fp.ClosedLoop(smooth_body(), controller()), block),
    )


def table():
    return np.sin(np.linspace(0.0, 7.0, 30))


REFERENCES = [
    reference_case("constant", lambda: fp.Constant(1.0)),
    reference_case("sine", lambda: fp.Sine(1.0, 2.0, 0.3, 0.1)),
    reference_case("chirp", lambda: fp.Chirp(1.0, 1.0, 5.0, 0.5)),
    reference_case("triangle", lambda: fp.Triangle(1.0, 2.0, 0.3)),
    reference_case("square", lambda: fp.Square(1.0, 2.0, 0.3)),
    reference_case("multisine", lambda: fp.Multisine([1.0, 0.5], [2.0, 5.0], [0.1, 0.7])),
    reference_case("recorded_held", lambda: fp.Recorded(table(), 0.0171)),
    reference_case("recorded_interpolated", lambda: fp.Recorded(table(), 0.0171, hold=False)),
]
