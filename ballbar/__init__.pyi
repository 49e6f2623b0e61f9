"""Names that `from ballbar import ...` offers, each from its module.

Type checkers and editors read this file, and the package looks up its names in it.
"""

from acquisition.pose_tables import read_poses as read_poses
from acquisition.recording import Recording as Recording
from acquisition.recording import read_recording as read_recording
from ballbar.result.calibration import Calibration as Calibration
from ballbar.result.calibration import load_calibration as load_calibration
from ballbar.result.run_data import RunData as RunData
from ballbar.result.run_recordings import identify_recordings as identify_recordings
from ballbar.result.verification import verify_folder as verify_folder
from ballbar.result.write_calibration import write_calibration as write_calibration
from ballbar.scenario import Scenario as Scenario
from ballbar.scenario import load_scenario as load_scenario
from ballbar.scenario import scenario_file as scenario_file
from cell.descriptions import Cell as Cell
from cell.descriptions import Robot as Robot
from cell.errors import FailureError as FailureError
from cell.errors import InputError as InputError
from cell.geometry import Geometry as Geometry
from cell.geometry import bar_frames as bar_frames
from cell.geometry import nominal_geometry as nominal_geometry
from cell.geometry import robot_frames as robot_frames
from cell.load import load_cell as load_cell
from cell.load import load_robot as load_robot
from cell.logs import BallBarLog as BallBarLog
from cell.logs import ForceLog as ForceLog
from cell.logs import RobotLog as RobotLog
from cell.payload import Payload as Payload
from cell.poses import PoseGroup as PoseGroup
from cell.poses import PoseTable as PoseTable
from cell.robot_angles import controller_to_joints as controller_to_joints
from cell.robot_angles import joints_to_axes as joints_to_axes
from ident.held_out import HeldOut as HeldOut
from ident.held_out import held_out as held_out
from ident.identify import identify as identify
from ident.identify import identify_poses as identify_poses
from ident.identify import identify_together as identify_together
from ident.options import FitOptions as FitOptions
from ident.options import Listener as Listener
from ident.recording_fit import Logs as Logs
from ident.result import Identification as Identification
from ident.robot.accuracy import TcpError as TcpError
from ident.robot.accuracy import accuracy_grid as accuracy_grid
from ident.robot.accuracy import position_error as position_error
from ident.robot.accuracy import tcp_error as tcp_error
from ident.robot.identified import IdentifiedRobot as IdentifiedRobot
from ident.robot.identified import PositionUncertainty as PositionUncertainty
from ident.robot.identified_kinematics import IdentifiedKinematics as IdentifiedKinematics
from ident.robot.identified_kinematics import JointSolutions as JointSolutions
from ident.robot.inverse_calibration import CorrectedTargets as CorrectedTargets
from ident.robot.inverse_calibration import corrected_targets as corrected_targets
from ident.verification import Verification as Verification
from ident.verify_table import verify as verify
from sim.recording_files import write_recording as write_recording
from sim.simulate import Simulation as Simulation
from sim.simulate import simulate as simulate
from sim.truth import Truth as Truth
from sim.truth import load_truth as load_truth

PACKAGES: tuple[str, ...]
