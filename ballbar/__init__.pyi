"""Names that `from ballbar import ...` offers, each from its module.

Type checkers and editors read this file, and the package looks up its names in it.
"""

from ballbar.acquisition.pose_tables import PoseImport as PoseImport
from ballbar.acquisition.recording import Recording as Recording
from ballbar.cell.descriptions import Cell as Cell
from ballbar.cell.descriptions import Robot as Robot
from ballbar.cell.errors import FailureError as FailureError
from ballbar.cell.errors import InputError as InputError
from ballbar.cell.geometry import Geometry as Geometry
from ballbar.cell.geometry import bar_frames as bar_frames
from ballbar.cell.geometry import nominal_geometry as nominal_geometry
from ballbar.cell.geometry import robot_frames as robot_frames
from ballbar.cell.load import load_cell as load_cell
from ballbar.cell.load import load_robot as load_robot
from ballbar.cell.logs import BallBarLog as BallBarLog
from ballbar.cell.logs import ForceLog as ForceLog
from ballbar.cell.logs import LengthLog as LengthLog
from ballbar.cell.logs import RobotLog as RobotLog
from ballbar.cell.payload import Payload as Payload
from ballbar.cell.poses import PoseGroup as PoseGroup
from ballbar.cell.poses import PoseTable as PoseTable
from ballbar.cell.robot_angles import controller_to_joints as controller_to_joints
from ballbar.cell.robot_angles import joints_to_axes as joints_to_axes
from ballbar.ident.options import FitOptions as FitOptions
from ballbar.ident.options import Listener as Listener
from ballbar.ident.recording_fit import Logs as Logs
from ballbar.ident.robot.accuracy import TcpError as TcpError
from ballbar.ident.robot.accuracy import accuracy_grid as accuracy_grid
from ballbar.ident.robot.accuracy import tcp_error as tcp_error
from ballbar.ident.robot.identified import IdentifiedRobot as IdentifiedRobot
from ballbar.ident.robot.identified import PositionUncertainty as PositionUncertainty
from ballbar.ident.robot.identified_kinematics import IdentifiedKinematics as IdentifiedKinematics
from ballbar.ident.robot.identified_kinematics import JointSolutions as JointSolutions
from ballbar.ident.robot.inverse_calibration import CorrectedTargets as CorrectedTargets
from ballbar.ident.verification import Verification as Verification
from ballbar.recordings.read import read as read
from ballbar.result.calibration import Calibration as Calibration
from ballbar.result.calibration import load as load
from ballbar.result.identify import identify as identify
from ballbar.result.verification import verify as verify
from ballbar.run import simulate as simulate
from ballbar.sim.simulate import Simulation as Simulation
from ballbar.sim.still_poses import PoseSimulation as PoseSimulation
from ballbar.sim.truth import Truth as Truth
from ballbar.sim.truth import load_truth as load_truth

PACKAGES: tuple[str, ...]
