"""Robot arms: models as data (one TOML file per arm), and kinematics.

The kinematics need numpy (extra ``virtual``); the models do not.
"""

from __future__ import annotations

from orinkit.arms.models import (
    DEFAULT_PATH,
    DEFAULT_SECONDS_TO_SPEED,
    MODEL_NAMES,
    ArmKind,
    ArmModel,
    AxisModel,
    joint_unit,
    load_model,
    model_of_type,
    parse_model,
)

__all__ = [
    "DEFAULT_PATH",
    "DEFAULT_SECONDS_TO_SPEED",
    "MODEL_NAMES",
    "ArmKind",
    "ArmModel",
    "AxisModel",
    "joint_unit",
    "load_model",
    "model_of_type",
    "parse_model",
]
