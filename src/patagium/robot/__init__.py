"""Robots: bodies, joints, wings and linkages as validated, frozen models."""

from patagium.robot.files import (
    load_robot,
    load_robot_text,
    load_urdf,
    load_urdf_text,
    preset_names,
    preset_text,
    write_template,
)
from patagium.robot.linkage import Linkage, LinkageMotion
from patagium.robot.model import Body, Joint, Robot, Strip

__all__ = [
    "Body",
    "Joint",
    "Linkage",
    "LinkageMotion",
    "Robot",
    "Strip",
    "load_robot",
    "load_robot_text",
    "load_urdf",
    "load_urdf_text",
    "preset_names",
    "preset_text",
    "write_template",
]
