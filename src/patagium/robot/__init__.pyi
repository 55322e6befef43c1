from patagium.robot.files import load_robot as load_robot
from patagium.robot.files import load_robot_text as load_robot_text
from patagium.robot.files import load_urdf as load_urdf
from patagium.robot.files import load_urdf_text as load_urdf_text
from patagium.robot.files import preset_names as preset_names
from patagium.robot.files import preset_text as preset_text
from patagium.robot.files import write_template as write_template
from patagium.robot.linkage import Linkage as Linkage
from patagium.robot.linkage import LinkageMotion as LinkageMotion
from patagium.robot.model import Body as Body
from patagium.robot.model import Joint as Joint
from patagium.robot.model import Robot as Robot
from patagium.robot.model import Strip as Strip

__all__: list[str]
