"""The measures of a run that need no observer."""

import fpjax as fp

MEASURES = {
    "mean": fp.MeanAbsolute(),
    "root": fp.RootMeanSquare(),
    "square": fp.MeanSquare(),
    "spread": fp.StandardDeviation(fp.velocity_error),
    "largest": fp.Largest(fp.compensation_error),
    "final": fp.Final(fp.velocity_error),
    "gradient": fp.GradientRootMeanSquare(),
    "effort": fp.control_effort(),
    "torque": fp.CoulombTorqueError(20.0),
}
