"""Robot calibration with a sensed double ball-bar: what a user of Python needs, under one name.

    from ballbar import BallBarLog, RobotLog, identify, load_cell

Each name is imported from its module when it is first used, so `import ballbar` takes milliseconds.
"""

from importlib import import_module
from typing import TYPE_CHECKING

PACKAGES = ("cell", "sim", "acquisition", "ident", "planning", "ballbar")  # of this project

_PUBLIC = {
    "cell.descriptions": "Cell Robot",
    "cell.load": "load_cell load_robot",
    "cell.payload": "Payload",
    "cell.robot_angles": "controller_to_joints joints_to_axes",
    "cell.errors": "InputError FailureError",
    "cell.geometry": "Geometry nominal_geometry robot_frames bar_frames",
    "cell.logs": "RobotLog BallBarLog ForceLog",
    "acquisition.recording": "Recording read_recording",
    "ident.identify": "identify identify_together",
    "ident.options": "FitOptions Listener",
    "ident.recording_fit": "Logs",
    "ident.result": "Identification",
    "ident.held_out": "HeldOut held_out",
    "cell.poses": "PoseGroup PoseTable",
    "acquisition.poses.reading": "read_poses",
    "ident.identify_poses": "PoseOptions identify_poses",
    "ident.pose_result": "PoseIdentification",
    "ident.pose_verification": "Verification verify",
    "ident.robot.identified_arm": "IdentifiedArm",
    "ident.robot.identified_kinematics": "IdentifiedKinematics JointSolutions",
    "ident.robot.tool_covariance": "PositionUncertainty",
    "ident.robot.accuracy": "TcpError accuracy_grid position_error tcp_error",
    "ident.robot.inverse_calibration": "CorrectedTargets corrected_arm_targets corrected_targets",
    "ident.robot.unloaded_robot": "UnloadedRobot",
    "sim.recording_files": "write_recording",
    "sim.simulate": "Simulation simulate",
    "sim.truth": "Truth load_truth",
    "ballbar.scenario": "Scenario load_scenario scenario_file",
    "ballbar.result.calibration": "Calibration load_calibration write_calibration",
    "ballbar.result.pose_calibration": "PoseCalibration",
    "ballbar.result.run_data": "RunData",
    "ballbar.result.run_recordings": "identify_recordings",
    "ballbar.result.verification": "verify_folder",
    "ident.verification": "RecordingVerification",
}
_HOME = {name: module for module, names in _PUBLIC.items() for name in names.split()}
__all__ = sorted(_HOME)  # noqa: PLE0605  the table is the list

if TYPE_CHECKING:  # the same names, for type checkers and editors
    from acquisition.poses.reading import read_poses as read_poses
    from acquisition.recording import Recording as Recording
    from acquisition.recording import read_recording as read_recording
    from ballbar.result.calibration import Calibration as Calibration
    from ballbar.result.calibration import load_calibration as load_calibration
    from ballbar.result.calibration import write_calibration as write_calibration
    from ballbar.result.pose_calibration import PoseCalibration as PoseCalibration
    from ballbar.result.run_data import RunData as RunData
    from ballbar.result.run_recordings import identify_recordings as identify_recordings
    from ballbar.result.verification import verify_folder as verify_folder
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
    from ident.identify import identify_together as identify_together
    from ident.identify_poses import PoseOptions as PoseOptions
    from ident.identify_poses import identify_poses as identify_poses
    from ident.options import FitOptions as FitOptions
    from ident.options import Listener as Listener
    from ident.pose_result import PoseIdentification as PoseIdentification
    from ident.pose_verification import Verification as Verification
    from ident.pose_verification import verify as verify
    from ident.recording_fit import Logs as Logs
    from ident.result import Identification as Identification
    from ident.robot.accuracy import TcpError as TcpError
    from ident.robot.accuracy import accuracy_grid as accuracy_grid
    from ident.robot.accuracy import position_error as position_error
    from ident.robot.accuracy import tcp_error as tcp_error
    from ident.robot.identified_arm import IdentifiedArm as IdentifiedArm
    from ident.robot.identified_kinematics import IdentifiedKinematics as IdentifiedKinematics
    from ident.robot.identified_kinematics import JointSolutions as JointSolutions
    from ident.robot.inverse_calibration import CorrectedTargets as CorrectedTargets
    from ident.robot.inverse_calibration import corrected_arm_targets as corrected_arm_targets
    from ident.robot.inverse_calibration import corrected_targets as corrected_targets
    from ident.robot.tool_covariance import PositionUncertainty as PositionUncertainty
    from ident.robot.unloaded_robot import UnloadedRobot as UnloadedRobot
    from ident.verification import RecordingVerification as RecordingVerification
    from sim.recording_files import write_recording as write_recording
    from sim.simulate import Simulation as Simulation
    from sim.simulate import simulate as simulate
    from sim.truth import Truth as Truth
    from sim.truth import load_truth as load_truth
else:

    def __getattr__(name: str) -> object:
        """The public object of this name, imported now and kept (PEP 562)."""
        if name not in _HOME:
            raise AttributeError(f"module 'ballbar' has no {name!r}; public: {', '.join(__all__)}")
        value = globals()[name] = getattr(import_module(_HOME[name]), name)
        return value


def __dir__() -> list[str]:
    """All names, those not imported yet included."""
    return sorted({*globals(), *__all__})
