"""Predictors: one file per method, each says where obstacles will be.

The table below is all that is needed to list them; nothing is imported until one is used.
"""

BUILT_IN: dict[str, str] = {
    "constant_velocity": "wideberth.predictors.constant_velocity:ConstantVelocity",
    "kalman": "wideberth.predictors.kalman:Kalman",
    "oracle": "wideberth.predictors.oracle:Oracle",
    "static": "wideberth.predictors.static:Static",
    "var": "wideberth.predictors.var:VectorAutoregression",
}
