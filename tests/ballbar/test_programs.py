"""Whole programs corrected: targets alone change, all of them, or nothing is written."""

from __future__ import annotations

import errno
import json
import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward
from ballbar.cell.descriptions import Cell, ProgramLanguage, Robot
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry, nominal_chain, robot_frames
from ballbar.cell.inverse import refine
from ballbar.cell.load import load_robot
from ballbar.cell.payload import Payload, with_payload
from ballbar.cell.robot_angles import controller_to_joints, joints_to_axes
from ballbar.compensation.frames import FrameOptions, frame_options, pose_of_angles
from ballbar.compensation.program_text import Number, Reader, Token, number_text
from ballbar.compensation.programs import (
    CorrectedProgram,
    correct_program,
    read_programs,
    write_programs,
)
from ballbar.export.result import Result, load_result
from ballbar.ident.corrections.unit_weights import unit_weights
from tests.helpers.calibrations import GEARS, corrections_of, write_calibration_of
from tests.helpers.command_line import ballbar
from tests.helpers.pose_results import write_pose_result
from tests.helpers.programs import (
    FAR,
    TABLE,
    TOOL,
    e6pos,
    flange,
    frame,
    robtarget,
    table_frame,
    tool_frame,
)
from tests.helpers.simulated_recordings import perturbed

AXES = np.array(
    [[10, 20, 5, 30, 60, -100], [-30, 35, -10, -95, 40, 200], [60, 0, 20, 10, -50, 10]], dtype=float
)
KUKA_AXES = np.array(
    [[10, -80, 95, 30, 60, -100], [-30, -95, 100, -95, 40, 200], [60, -70, 80, 10, -50, 10]],
    dtype=float,
)
NONE = FrameOptions()
NUMBERED = replace(NONE, tools={"1": tool_frame()}, frames={"2": table_frame()})
UNNAMED = replace(NONE, tools={"": np.eye(4)}, frames={"": np.eye(4)})


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory, cell: Cell, nominal: Geometry) -> Result:
    rng = np.random.default_rng(3)
    return loaded(
        write_calibration_of(
            tmp_path_factory.mktemp("run") / "calibration.yaml",
            nominal,
            perturbed(nominal, rng, 5e-4),
            corrections=corrections_of(cell, GEARS, rng),
        )
    )


@pytest.fixture(scope="module")
def exact(tmp_path_factory: pytest.TempPathFactory, nominal: Geometry) -> Result:
    """A robot that is as its catalogue says."""
    path = tmp_path_factory.mktemp("exact") / "calibration.yaml"
    return loaded(write_calibration_of(path, nominal, nominal))


def loaded(path: Path) -> Result:
    out = load_result(path)
    assert isinstance(out, Result)
    return out


def module(robot: Robot, body: str = "") -> str:
    """RAPID with everything that is understood, comments in Latin-1, and lines of Windows."""
    p = [robtarget(robot, axes, tool_frame(), table_frame()) for axes in AXES]
    lines = [
        "%%%", "  VERSION:1", "  LANGUAGE:ENGLISH", "%%%", "",
        "MODULE Weld ! Schwei\xdfen, p10 := nothing",
        f"  PERS tooldata tGun:={TOOL};",
        f"\tTASK PERS wobjdata table1 := {TABLE};",
        f"  CONST robtarget p10:={p[0]};",
        f"  LOCAL VAR  robtarget p20 :=\t{p[1]} ;",
        f"  CONST jointtarget home:=[[0,10,-10.5,0,3.0E+01,0],{FAR}];",
        f"  CONST jointtarget row{{2}}:=[[[0,10,0,0,30,0],{FAR}],[[1,10,0,0,30,0],{FAR}]];",
        '  CONST string note:="MoveL p10 ""Offs(p10,0,0,1)""";',
        "  PROC main()",
        r"    MoveAbsJ home\NoEOffs,v1000,fine,tool0;",
        r"    MoveAbsJ row{2}\NoEOffs,v1000\T:=2,z5,tGun;",
        r"    IF di1=1 MoveJ p10,v500,z50,tGun\WObj:=table1;",
        r"    movel \Conc, p20,v100,",
        r'      z1,tGun \WObj:=table1; ! to "Offs(p10,1,2,3)"',
        rf"    MoveC p10,{p[2]},v100,z1,tGun\WObj:=table1;",
        body,
        "    Weave; WaitTime 0.5; Set do1;",
        "  ENDPROC", "ENDMODULE", "",
    ]  # fmt: skip
    return "\r\n".join(lines)


def moves(robot: Robot, *axes: Array) -> str:
    """A module that moves to axis angles [deg] with tool0."""
    points = (robtarget(robot, row, np.eye(4), np.eye(4)) for row in axes)
    lines = "\n".join(f"MoveL {point},v1,z1,tool0;" for point in points)
    return f"MODULE m\nPROC a()\n{lines}\nENDPROC\nENDMODULE\n"


def line_to(robot: Robot, axes: Array) -> str:
    """A KRL program that moves to axis angles [deg]; tool and base are the options'."""
    return f"DEF m()\nLIN {e6pos(robot, axes, np.eye(4), np.eye(4))}\nEND\n"


def corrected(
    path: Path, text: str, result: Result, options: FrameOptions = NONE
) -> CorrectedProgram:
    path.write_bytes(text.encode("latin-1"))
    if path.suffix == ".pdl":
        result = programmed(result, "pdl2")
    return correct_program(read_programs(path, options)[0], result)


def programmed(result: Result, language: ProgramLanguage) -> Result:
    """The result of a robot whose controller takes another language."""
    robot = replace(result.robot, program_language=language)
    return replace(result, cell=replace(result.cell, robot=robot))


def without_numbers(text: str) -> str:
    return re.sub(r"-?\d+\.?\d*(E[+-]?\d+)?", "#", text)


def test_a_nominal_robot_gets_the_same_program_byte_for_byte(
    tmp_path: Path, exact: Result, kuka: Path
) -> None:
    text = module(exact.robot)
    assert corrected(tmp_path / "weld.mod", text, exact).text == text
    assert corrected(tmp_path / "weld.pdl", pdl2(), exact).text == pdl2()
    result, texts = load_result(kuka), src(load_robot("kr10_r1100"))
    nominal = {
        name: entry.model_copy(update={"value": entry.nominal})
        for name, entry in result.calibration.file.parameters.items()
    }
    file = result.calibration.file.model_copy(update={"parameters": nominal, "corrections": {}})
    unchanged = replace(result, calibration=replace(result.calibration, file=file))
    programs = read_programs(write_pair(tmp_path, *texts), NUMBERED)
    assert [correct_program(program, unchanged).text for program in programs] == list(texts)


def test_nothing_but_the_numbers_of_targets_changes(tmp_path: Path, result: Result) -> None:
    text = module(result.robot)
    done = corrected(tmp_path / "weld.mod", text, result)
    assert without_numbers(done.text) == without_numbers(text)
    changed = [
        k for k, pair in enumerate(zip(text.split("\n"), done.text.split("\n"), strict=True))
        if pair[0] != pair[1]
    ]  # fmt: skip
    assert [k + 1 for k in changed] == [9, 10, 11, 12, 20]
    assert len(done.program.targets) == 6, "home, two of the array, p10, p20, the one in MoveC"
    for new, old in zip(re.findall(r"\],\[[-\d,]+\],\[9E", done.text),
                        re.findall(r"\],\[[-\d,]+\],\[9E", text), strict=True):  # fmt: skip
        assert new == old, "configurations stay"


def reached(result: Result, payload: Payload | None, q: Array) -> Array:
    """(N, 4, 4) where the identified robot puts the end of the plate."""
    robot = result.calibration.identified_robot(cell=result.cell)
    if payload is not None:
        robot = replace(robot, description=with_payload(robot.cell, payload))
    return robot.poses(q)


def test_the_controller_takes_the_identified_robot_from_the_new_targets_to_the_nominal_poses(
    tmp_path: Path, result: Result
) -> None:
    """The controller is the nominal chain, solved again from the numbers of the corrected text."""
    robot = result.robot
    done = corrected(tmp_path / "weld.mod", module(robot), result)
    chain, payload = nominal_chain(robot), Payload(4.2, np.array([0.005, 0.0, 0.09]))
    for start_of, axes in zip((" p10:=", " p20 :=", "MoveC p10"), AXES, strict=True):
        at = done.text.index("[[", done.text.index(start_of))
        values = [float(v) for v in re.findall(r"-?\d+\.?\d*", done.text[at:])[:7]]
        pose = table_frame() @ frame(values[:3], values[3:]) @ np.linalg.inv(tool_frame())
        start = controller_to_joints(robot, np.radians(axes))[None]
        q = refine(chain, start, pose[None])
        wanted = robot_frames(result.calibration.nominal, start).poses()
        miss = reached(result, payload, q) - wanted
        assert np.abs(miss[:, :3, 3]).max() < 3e-6, "digits of the text: 1 um and 1e-8"
        assert np.abs(miss[:, :3, :3]).max() < 1e-6
        nominal_miss = reached(result, payload, start) - wanted
        assert np.abs(nominal_miss[:, :3, 3]).max() > 1e-3


def test_the_load_of_the_tool_counts_and_an_option_replaces_it(
    tmp_path: Path, result: Result
) -> None:
    text = module(result.robot)
    declared, stated, none = (
        corrected(tmp_path / f"{k}.mod", text.replace("[4.2,[5,0,90]", load), result, options)
        for k, (load, options) in enumerate(
            [
                ("[4.2,[5,0,90]", NONE),
                ("[0,[0,0,0]", frame_options((), (), ("tGun=4.2,5,0,90",), ())),
                ("[-1,[0,0,0]", NONE),
            ]
        )
    )
    np.testing.assert_array_equal(declared.corrected.q, stated.corrected.q)
    assert np.abs(declared.corrected.q - none.corrected.q).max() > 1e-6
    assert any("payload of tGun, tool0 is not known" in note for note in none.notes)
    assert any("payload of tool0 is not known" in note for note in declared.notes)


def test_where_no_masses_are_known_the_load_of_a_program_is_said_to_be_left_out(
    tmp_path: Path, result: Result
) -> None:
    weightless = replace(result.cell, robot=replace(result.robot, links=None))
    file, (entry, *_) = result.calibration.file, result.calibration.file.corrections.values()
    value = next(iter(entry.values())).model_copy(update={"value": 0.0})
    sag = {c.name: value for c in unit_weights(weightless.robot).coefficients}
    own = file.model_copy(update={"corrections": {"unit_weights": sag}})
    bare = replace(result, calibration=replace(result.calibration, file=own), cell=weightless)
    notes = corrected(tmp_path / "weld.mod", module(result.robot), bare).notes
    assert any("payload of the recording: the robot's file has no masses" in n for n in notes)


RAPID_REFUSED = {
    r"MoveL Offs(p10,0,0,10),v100,z1,tGun\WObj:=table1;": r"target of MoveL is computed \('O",
    r"p20 := p10;": r"p20 is assigned or used outside of a move instruction .* on a line",
    r"x := p10.trans.z + 1;": r"p10 is assigned or used",
    r"MoveL p10,v1,z1,tGun;": r":9: p10 is reached with other .* in lines 17 and 21;",
    r"MoveL pFar,v1,z1,tGun;": r"target of MoveL, pFar, has no constant .* --keep pFar",
    r"MoveL p10,v1,z1,tOther\WObj:=table1;": r"tool tOther is not stated .* --tool tOther=",
    r"MoveL p20,v1,z1,tGun\WObj:=wobj9;": r"work object wobj9 is not stated .* --frame",
    r"MoveL *,v1,z1,tGun;": r"target of MoveL is computed",
    r"MoveAbsJ p10,v1,z1,tGun;": r"the target is a robtarget, which MoveAbsJ does not take",
    r"MoveAbsJ [[0,1,2,3,4],[9E9]],v1,z1,tGun;": r"MoveAbsJ: 5 values where 6 are expected",
    r"MoveAbsJ [[0,1+1,2,3,4,5],[9E9]],v1,z1,tGun;": r".*a comma or '\]', there is '\+'",
    r"MoveAbsJ [[0,nX,2,3,4,5],[9E9]],v1,z1,tGun;": r".*'nX' is no number; computed",
    r"MoveAbsJ [[9E9,0,2,3,4,5],[9E9]],v1,z1,tGun;": r"MoveAbsJ: 9E9 stands for",
    r"MoveAbsJ [[0,0,0,0,30,999],[9E9]],v1,z1,tGun;": r"MoveAbsJ: axis 6 of the given target",
    r"MoveAbsJ [[0,0,0,0,0,0],[9E9]],v1,z1,tGun;": r"MoveAbsJ: the robot stands at a singul",
    r"MoveL [[9000,0,0],[1,0,0,0],[0,0,0,0],[9E9]],v1,z1,tool0;": r".*does not reach",
    r"MoveL [[900,0,0],[1,1,0,0],[0,0,0,0],[9E9]],v1,z1,tool0;": r".*has not unit length",
    r"SearchL di1,p20,p10,v1,tGun;": r"SearchL is not a move instruction .MoveAbsJ",
    r"PDispOn p10,tGun;": r"PDispOn changes a program displacement",
    r"GripLoad load1;": r"GripLoad changes the load .* --payload",
    r"MoveL p10,v1,z1,tGun\WObj:=table1\TLoad:=load1;": r"\\TLoad replaces",
    r"tGun := tool0;": r"tGun is assigned or used outside",
    r"CONST jointtarget home:=[[0,0,0,0,9,0],[9E9]];": r"home is declared twice",
    r"VAR robtarget late; MoveL late,v1,z1,tGun;": r"late has no constant value",
    r"CONST robtarget idle:=[[900,0,900],[1,0,0,0],[0,0,0,0],[9E9]];": r"idle: no move of th",
    rf"Pick [[900,0,900],[1,0,0,0],[0,0,0,0],{FAR}],v1;": r"a target is written where none is read",
    r"MoveL p10,v1,z1,;": r"tool of MoveL is no name",
    r"MoveL p10,v1,z1,tl{2}\WObj:=table1;": r"tool of MoveL is no name .*\(tl\{2\}\)",
    r"MoveL p10,v1,z1,tGun\WObj:=wo{2};": r"work object of MoveL is no name .*wo\{2\}",
    r"MoveL p10,v1,z1,tGun\WObj?w;": r".WObj is not given by :=",
    r"table1.oframe.trans.x:=5;": r"table1 is assigned or used outside",
    r"ENDPROC PROC b(PERS tooldata tGun)": r"tGun is assigned or used outside",
    r"MoveL [[900,0,900],[1,0,0,0],[0,0,0,0],[1200,9E9]],v1,z1,tool0;": r".*axis 1 stands",
    r"MoveL [[900,0,900],[1,0,0,0],[0,0.5,0,0],[9E9]],v1,z1,tool0;": r".*whole numbers",
    r"MoveL [[-\n10,0,0],[1,0,0,0],[0,0,0,0],[9E9]],v1,z1,tool0;".replace(r"\n", "\n"): r".*sign",
    r"ConfL\Off;": r"after ConfL the robot takes the nearest configuration",
    r"SingArea\Wrist;": r"after SingArea",
    r"MoveL p10,v1": r"MoveL has 2 arguments, expected 4",
}


KRL_REFUSED = {
    "PTP_REL {A1 10}": r"PTP_REL moves by a distance",
    "BRAKE": r"BRAKE moves by a distance",
    "LIN XP1:XP2": r"target of LIN is computed \(':'\); write it with constant values",
    "LIN": r"target of LIN is computed \(the end of the statement\)",
    "PTP OFFSET(XP1)": r"target of PTP is computed \('OFFSET'\)",
    "XP1.X=XP1.X+10": r"XP1 is assigned or used outside of a motion",
    "MOVE_TO(XP1)": r"XP1 is assigned or used outside",
    "PTP XHOME": r"target of PTP, XHOME, has no constant value .* --keep XHOME",
    "PTP {A1 10,A2 20}": r"PTP: expected A1, A2, A3, A4, A5, A6, there are A1, A2",
    "PTP {A1 10,5,A2 20}": r"PTP: expected A1, .* there are A1, 1, A2; decimals",
    "PTP {A1 10,A1 20}": r".*A1 stands twice",
    "PTP {A1 x,A2 -90,A3 90,A4 0,A5 0,A6 0}": r"PTP: 'x' is no number",
    "LIN {X 100,Y 0,Z 10,A 0,B 0,C 0,S 2}": r"LIN: S and T are both needed",
    "LIN {X 900,Y 0,Z 900,A 0,B 90,C 0}": r"LIN: states no conf.*; touch it up",
    "LIN {X 100,Y 0,Z 10,A 0,B 0,C 0,S 'B2',T 2}": r".* is no number",
    "LIN {X 100,Y 0,Z 10,A 0,B 0,C 0,S 2.5,T 2}": r"LIN: S and T are whole numbers",
    "MOVE_TO({A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0})": r"a target is written where none is read",
    "L: PTP {A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}": r"a motion within a line is not read",
    "DECL E6POS XP3={X 1,Y 2,Z 3,A 0,B 0,C 0}:XP2": r"XP3 is computed \(':' after its value\)",
    "DECL E6POS XP1={X 1,Y 2,Z 3,A 0,B 0,C 0}": r":2: XP1 is declared twice",
    "SLIN XP1 WITH $TOOL=F(2)": r"\$TOOL, .* TOOL_DATA.1.* is computed .* constant",
    "SLIN XP1 WITH $TOOL=$NULLFRAME:TOOL_DATA[2]": r"\$TOOL, .* is computed",
    "SLIN XP1 WITH $BASE={X 1,Y 0,Z 0,A 0,B 0,C 0}:BASE_DATA[3]": r"\$BASE is computed",
    "SLIN XP1 WITH $VEL=1 $TOOL=TOOL_DATA[2]": r"WITH: a comma is expected",
    "SLIN XP1 WITH $IPO_MODE=SIPO_MODE(FP3.IPO_FRAME)": r"FP3: a tool that stands in the cell",
    "$IPO_MODE=#TCP": r"\$IPO_MODE: a tool that stands in the cell",
    "$LOAD={M 5,CM {X 0,Y 0,Z 0}}": r"\$LOAD is set by the program; .* state it by --payload",
    **dict.fromkeys(
        (
            "$TOOL=TOOL_DATA[2]", "$TOOL={X 0,Y 0,Z 0,A 0,B 0,C 0}", "$BASE.X=10", "BAS(#TOOL,2)",
            "BAS(#BASE,N)", "BAS(#EX_BASE,2)", "IF X THEN $TOOL=TOOL_DATA[2]",
            "IF X THEN BAS(#TOOL,2)", "IF X THEN FDAT_ACT=FP2", "FP2.TOOL_NO=1",
            "FDAT_ACT.TOOL_NO=1", "TOOL_DATA[1]=TOOL_DATA[2]", "$ROBROOT={X 0,Y 0,Z 5,A 0,B 0,C 0}",
            "SLIN XP1 WITH $TOOL.X=5",
        ),
        r".* is set by the program, .* write them into the motions, .* or take the line out and "
        r"state them by --tool and --frame",
    ),
}  # fmt: skip
PDL2_REFUSED = {
    "  MOVE TO POS(100, 0, 500, 0, 90, 0, '')": r"MOVE: cartesian .*; state the",
    "  p1 := POS(100, 0, 500, 0, 90, 0, '')": r"p1: cartesian positions of PDL2",
    "  MOVE RELATIVE VEC(0, 0, 10) IN TOOL": r"MOVE RELATIVE: where to is computed",
    "  MOVE TO other": r"target of MOVE, other, has no constant value",
    "  home[3] := home[3] + 5": r"home is assigned or used outside of MOVE",
    "  go({0, 0, 0, 0, 30, 0})": r"a target is written where none is read",
    "  MOVE TO home SYNCMOVE ARM[2] TO home": r"SYNCMOVE is not understood",
    "  MOVE TO {0, a, 0, 0, 0, 0}": r"MOVE: 'a' is no number",
    "  MOVE": r"MOVE without TO: where to is computed",
    "  IF x THEN home := other": r"home is assigned or used outside of MOVE",
    "  home := {0, 0, 0, 0, 0, 0}; home := other": r"home is assigned or used outside of MOVE",
    "ROUTINE f(home : JOINTPOS)": r"home is assigned or used outside of MOVE",
    "  IF x THEN other := {0, 0, 0, 0, 0, 0}": r"a target is written where none is read",
    "  home := {0, 0, 0, 0, 0, 0} + d": r"home is computed \('\+' after",
    "  MOVE TO home; MOVE TO JNTP(0, 0, 0, 0, 0, 0)": r"MOVE has another target",
    "  VAR other : JOINTPOS FOR ARM[2]": r"ARM\[2\] is not the program's arm",
}


@pytest.mark.parametrize(
    ("suffix", "line", "message"),
    [(".mod", *case) for case in RAPID_REFUSED.items()]
    + [(".src", *case) for case in KRL_REFUSED.items()]
    + [(".pdl", *case) for case in PDL2_REFUSED.items()],
)
def test_what_is_not_understood_is_refused_with_its_line(
    tmp_path: Path, result: Result, kuka: Path, suffix: str, line: str, message: str
) -> None:
    place = {".mod": 21, ".src": 4, ".pdl": 7}[suffix]
    match = message if message.startswith(":") else rf":{place}: {message}"
    path = tmp_path / f"weld{suffix}"
    of_language = {".mod": result, ".pdl": programmed(result, "pdl2")}
    if suffix == ".src":
        krl_of(tmp_path, [line])
    else:
        path.write_text(module(result.robot, line) if suffix == ".mod" else pdl2(line))
    options, robot = UNNAMED if suffix == ".src" else NONE, of_language.get(suffix)
    with pytest.raises(InputError, match=match) as refusal:
        correct_program(read_programs(path, options)[0], robot or load_result(kuka))
    assert str(refusal.value).startswith("nothing was written.")


def test_instructions_that_leave_targets_as_they_are_taken_are_accepted(
    tmp_path: Path, exact: Result
) -> None:
    lines = r"ConfL\On; ConfJ\On; SingArea\Off; now:=CRobT(\Tool:=tGun\WObj:=table1);"
    text = module(exact.robot, lines)
    assert corrected(tmp_path / "weld.mod", text, exact).text == text
    joints = f"MoveAbsJ [[0,10,0,0,30,0],[1200,{FAR[1:]}],v1,z1,tool0;"
    text = f"MODULE m\nPROC a()\nConfJ\\Off;\n{joints}\nENDPROC\nENDMODULE\n"
    assert corrected(tmp_path / "joints.mod", text, exact).text == text, "no configuration counts"


def test_a_tool_that_a_routine_is_given_is_not_that_of_an_option_for_all_others(
    tmp_path: Path, exact: Result
) -> None:
    point = robtarget(exact.robot, AXES[0], np.eye(4), np.eye(4))
    text = (
        "MODULE m\nPROC a(PERS tooldata tArg, PERS wobjdata wArg)\n"
        f"MoveL {point},v1,z1,tArg\\WObj:=wArg;\nENDPROC\nENDMODULE\n"
    )
    others = FrameOptions({"": np.eye(4)}, {"": np.eye(4)})
    with pytest.raises(InputError, match=r":3: tArg is given to the routine"):
        corrected(tmp_path / "m.mod", text, exact, others)
    with pytest.raises(InputError, match=r":3: wArg is given to the routine"):
        corrected(tmp_path / "m.mod", text, exact, replace(others, tools={"targ": np.eye(4)}))
    named = FrameOptions({"targ": np.eye(4)}, {"warg": np.eye(4)})
    assert corrected(tmp_path / "m.mod", text, exact, named).text == text


def test_a_configuration_that_no_solution_has_is_refused(tmp_path: Path, result: Result) -> None:
    text = module(result.robot).replace("[0,0,-2,0]", "[2,0,-2,0]")
    with pytest.raises(InputError, match=r":9: p10: no solution .* configuration \[2, 0, -2, 0\]"):
        corrected(tmp_path / "weld.mod", text, result)


def written_quadrants(text: str) -> list[int]:
    """Quadrants of axes 1, 4 and 6 in a corrected module with one robtarget."""
    return [int(v) for v in re.findall(r"\],\[(-?\d),(-?\d),(-?\d),\d\],\[9", text)[0]]


def turn_of(axes: Array) -> int:
    return int(((axes < 0.0) * 2 ** np.arange(6)).sum())


def test_an_axis_that_passes_a_limit_takes_its_configuration_along(
    tmp_path: Path, result: Result, kuka: Path
) -> None:
    """An axis at 0.001 deg is corrected to below zero or up; one of two signs crosses."""
    crossed = {"m.mod": 0, "m.src": 0}
    for angle in (0.001, -0.001, 90.001, 89.999):
        axes = np.array([20.0, 10.0, 5.0, angle, 40.0, 30.0])
        done = corrected(tmp_path / "m.mod", moves(result.robot, axes), result)
        after = axes[3] + np.degrees(done.axis_changes[0, 3])
        assert written_quadrants(done.text)[1] == int(np.floor(after / 90.0))
        crossed["m.mod"] += any("configuration" in note for note in done.notes)
    for angle in (1e-3, -1e-3):
        axes = np.array([10.0, -80.0, 95.0, angle, 60.0, angle])
        text = line_to(load_robot("kr10_r1100"), axes)
        done = corrected(tmp_path / "m.src", text, load_result(kuka), UNNAMED)
        turned = axes + np.degrees(done.axis_changes[0])
        assert int(re.findall(r",T (\d+)", done.text)[0]) == turn_of(turned)
        crossed["m.src"] += any("configuration" in note for note in done.notes)
    assert crossed["m.mod"] == 2
    assert crossed["m.src"] >= 1


@pytest.mark.parametrize("given", [0, -1])
def test_axes_4_and_6_at_zero_take_the_quadrant_that_they_are_corrected_into(
    tmp_path: Path, result: Result, given: int
) -> None:
    """Regression: digits leave a zero on either side of zero, and the quadrant was kept then."""
    changed = 0
    for axes in ([0, 10, 5, 0, 40, 0], [20, 0, 0, 0, 60, 0], [-50, 30, 10, 0, -40, 0]):
        quadrants = f"[{int(axes[0] // 90)},{given},{given},{int(axes[4] < 0)}]"
        text = moves(result.robot, np.array(axes, dtype=float))
        text = re.sub(r"\[[-\d]+,[-\d]+,[-\d]+,[-\d]+\]", quadrants, text)
        done = corrected(tmp_path / "m.mod", text, result)
        after = axes + np.degrees(done.axis_changes[0])
        assert written_quadrants(done.text) == [int(after[j] // 90.0) for j in (0, 3, 5)]
        changed += any("configuration" in note for note in done.notes)
    assert changed


@pytest.mark.parametrize("given", [0, 8, 32, 40])
def test_axes_4_and_6_at_zero_have_the_turn_of_the_sign_that_they_are_corrected_to(
    tmp_path: Path, kuka: Path, given: int
) -> None:
    """Regression: the bit was reversed where digits put the solved axis on the other side."""
    robot, result, changed = load_robot("kr10_r1100"), load_result(kuka), 0
    for start in ([10, -80, 95, 0, 60, 0], [-40, -95, 100, 0, 30, 0], [70, -60, 70, 0, -45, 0]):
        axes = np.array(start, dtype=float)
        turn = turn_of(axes)
        text = line_to(robot, axes).replace(f"T {turn}", f"T {turn | given}")
        done = corrected(tmp_path / "m.src", text, result, UNNAMED)
        written = int(re.findall(r",T (\d+)", done.text)[0])
        assert written == turn_of(axes + np.degrees(done.axis_changes[0]))
        changed += written != (turn | given)
    assert changed


def test_a_program_of_another_controller_than_the_robots_is_refused(
    tmp_path: Path, result: Result, kuka: Path
) -> None:
    text = module(result.robot)
    with pytest.raises(InputError, match=r"weld.mod: nothing .* is RAPID .* takes KRL"):
        corrected(tmp_path / "weld.mod", text, load_result(kuka))
    with pytest.raises(InputError, match=r"weld.MODX: nothing .* takes PDL2"):
        corrected(tmp_path / "weld.MODX", text, programmed(result, "pdl2"))
    unstated = replace(result.robot, program_language=None)
    unknown = replace(result, cell=replace(result.cell, robot=unstated))
    assert corrected(tmp_path / "weld.mod", text, unknown).text != text


def test_notes_of_configurations_do_not_compare_the_targets_with_one_another(
    tmp_path: Path, result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Regression: each target was compared with the changes of all, a minute for 5000."""

    def compared(number: Number, other: object) -> bool:
        raise AssertionError(f"{number} is compared with {other}")

    monkeypatch.setattr(Number, "__eq__", compared)
    axes = np.array([[20.0, 10.0, 5.0, angle, 40.0, 30.0] for angle in (0.001, -0.001)])
    done = corrected(tmp_path / "m.mod", moves(result.robot, *axes), result)
    notes = [note for note in done.notes if "becomes" in note]
    assert len(notes) == 1
    assert re.match(r"m.mod:[34]: configuration (0 becomes -1|-1 becomes 0), since", notes[0])


@pytest.mark.parametrize("full_suffix", [".src", ".dat"])
def test_of_two_files_none_is_written_where_one_cannot_be(
    tmp_path: Path, kuka: Path, monkeypatch: pytest.MonkeyPatch, full_suffix: str
) -> None:
    """Regression: the second file failed, and the first stayed without it."""
    texts = src(load_robot("kr10_r1100"))
    path = write_pair(tmp_path, *texts)
    programs = read_programs(path, NUMBERED)
    done = [correct_program(program, load_result(kuka)) for program in programs]
    out = tmp_path / "out" / "weld.src"
    renamed = Path.replace

    def full(source: Path, target: Path) -> Path:
        if target.suffix == full_suffix:
            raise OSError(errno.ENOSPC, "No space left on device", str(source))
        return renamed(source, target)

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        write_programs(out, done)
    assert list(out.parent.iterdir()) == []
    monkeypatch.undo()
    assert sorted(write_programs(out, done)) == sorted(out.parent.iterdir())


def test_the_tool_of_triggc_is_the_argument_after_the_zone(tmp_path: Path, result: Result) -> None:
    """CirPoint, ToPoint, Speed, Trigg_1, Zone, Tool (Technical reference manual, RAPID)."""
    robot, file = result.robot, tmp_path / "weld.mod"
    point = robtarget(robot, AXES[0], tool_frame(), table_frame())
    body = rf"TriggC {point},{point},v100,gun,z1,tGun\WObj:=table1;"
    file.write_bytes(module(robot, body).encode("latin-1"))
    tools = [t.setup.tool for t in read_programs(file, NONE)[0].targets if t.name == "TriggC"]
    assert len(tools) == 2
    np.testing.assert_allclose(tools, [tool_frame()] * 2, atol=1e-6)


@pytest.mark.parametrize(("tokens", "line"), [([], 7), ([Token("word", "a", 0, 1, 9)], 9)])
def test_a_statement_ends_on_the_line_of_its_last_token(tokens: list[Token], line: int) -> None:
    assert Reader(tokens, "a", 7, len(tokens)).token.line == line


def test_module_calls_without_arguments_are_named_as_not_corrected(
    tmp_path: Path, result: Result
) -> None:
    done = corrected(tmp_path / "weld.mod", module(result.robot, "MoveHome;"), result)
    assert "MoveHome is not in the file: its targets stay as they are" in done.notes


def src(robot: Robot) -> tuple[str, str]:
    """A .src and a .dat file as the teach pendant writes them."""
    p = [e6pos(robot, axes, tool_frame(), table_frame()) for axes in KUKA_AXES]
    program = [
        "&ACCESS RVP", "DEF weld( )", "EXT BAS (BAS_COMMAND :IN,REAL :IN )", ";FOLD INI;%{PE}",
        "  INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )", "  BAS (#INITMOV,0 )",
        ";ENDFOLD (INI)", ";FOLD PTP P1 Vel=100 % PDAT1 Tool[1]:Gun Base[2]:T\xe4ble;%{PE}",
        "$BWDSTART=FALSE", "PDAT_ACT=PPDAT1", "FDAT_ACT=FP1", "BAS(#PTP_PARAMS,100)", "PTP XP1",
        ";ENDFOLD", "LDAT_ACT=LCPDAT1", "FDAT_ACT=FP1", "BAS(#CP_PARAMS,2)", "LIN XP2 C_DIS",
        f"SLIN {p[2]} WITH $VEL=SVEL_CP(2.0, , LCPDAT1), "
        "$TOOL=STOOL2(FP1), $BASE=SBASE(FP1.BASE_NO)",
        "PTP {A1 10, A2 -80.5, A3 95, A4 0, A5 45, A6 -10, E1 0} C_PTP", "END", "",
    ]  # fmt: skip
    data = [
        "&ACCESS RVP", "DEFDAT  WELD PUBLIC", ";FOLD EXTERNAL DECLARATIONS", ";ENDFOLD",
        'DECL FDAT FP1={TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}',
        f"DECL E6POS XP1={p[0]}", f"DECL GLOBAL E6POS  XP2 = {p[1]} ; second",
        "DECL PDAT PPDAT1={VEL 100.000,ACC 100.000,APO_DIST 100.000}",
        "DECL FRAME UNUSED={X 1,Y 2,Z 3,A 0,B 0,C 0}", "ENDDAT", "",
    ]  # fmt: skip
    return "\r\n".join(program), "\r\n".join(data)


@pytest.fixture(scope="module")
def kuka(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pose_result(
        tmp_path_factory.mktemp("k") / "calibration.yaml", "kr10_r1100", seed=3
    )


def write_pair(folder: Path, program: str, data: str) -> Path:
    (folder / "weld.dat").write_bytes(data.encode("latin-1"))
    (folder / "weld.src").write_bytes(program.encode("latin-1"))
    return folder / "weld.src"


def test_a_pair_of_krl_files_is_corrected_as_one_program(tmp_path: Path, kuka: Path) -> None:
    result, robot = load_result(kuka), load_robot("kr10_r1100")
    texts = src(robot)
    path = write_pair(tmp_path, *texts)
    programs = read_programs(path, NUMBERED)
    assert [len(p.targets) for p in programs] == [2, 2]
    chain = nominal_chain(robot)
    for k, program in enumerate(programs):
        done = correct_program(program, result)
        assert without_numbers(done.text) == without_numbers(texts[k])
        for j, target in enumerate(program.targets):
            start = done.q[j : j + 1]
            wanted = forward(chain, start).poses()
            arm = result.calibration.identified_robot()  # type: ignore[union-attr]
            at = forward(arm.chain, arm.joints(done.corrected.q[j : j + 1])).poses()
            assert np.abs(at - wanted).max() < 1e-8
            if target.rotation is None:
                continue
            name = f"{target.name.upper()}=" if k else "SLIN "
            line = next(x for x in done.text.replace(" ", "").split("\r\n")
                        if name.strip() in x and "{X" in x)  # fmt: skip
            values = [float(re.search(rf"[{{,]{c}(-?[\d.]+)", line)[1]) for c in "XYZABC"]
            pose = table_frame() @ pose_of_angles(values) @ np.linalg.inv(tool_frame())
            q = refine(chain, done.corrected.q[j : j + 1], pose[None])
            assert np.abs(q - done.corrected.q[j]).max() < 2e-5, "digits of the text"


def test_the_turn_is_that_of_the_digits_where_they_decide_the_sign(
    tmp_path: Path, kuka: Path
) -> None:
    """Axis 6 is corrected to a few 1e-5 deg, less than what the digits are rounded to."""
    robot, result = load_robot("kr10_r1100"), load_result(kuka)
    axes, shift = np.array([10.0, -80.0, 95.0, 20.0, 60.0, 0.0]), 0.0
    for offset in (0.0, *np.linspace(-4e-5, 4e-5, 9)):
        axes[5] = offset - shift
        done = corrected(tmp_path / "m.src", line_to(robot, axes), result, UNNAMED)
        shift = float(np.degrees(done.axis_changes[0, 5]))
        values = [float(re.search(rf"[{{,]{c} (-?[\d.]+)", done.text)[1]) for c in "XYZABC"]
        q = refine(nominal_chain(robot), done.corrected.q, pose_of_angles(values)[None])
        solved = np.degrees(joints_to_axes(robot, q))[0]
        assert int(re.findall(r",T (\d+)", done.text)[0]) == turn_of(solved)


POSE = "{X 100,Y 0,Z 10,A 0,B 0,C 0,S 'B010',T 'H2'}"
AXIS_POINT = "{A1 0,A2 -90,A3 90,A4 0,A5 30,A6 0}"
OTHER_TOOLS = replace(
    NONE,
    tools={str(k): pose_of_angles([k, 0, 0, 0, 0, 0]) for k in range(1, 4)} | UNNAMED.tools,
    frames={str(k): pose_of_angles([k, 0, 0, 0, 0, 0]) for k in range(1, 4)} | UNNAMED.frames,
    payloads={"1": Payload(1.0, np.zeros(3)), "2": Payload(2.0, np.zeros(3))},
)


def krl_of(folder: Path, lines: list[str], *more: str) -> Path:
    """A program that begins with moves to XP1 and XP2, and data sets of the tools 2 and 3."""
    robot = load_robot("kr10_r1100")
    points = (e6pos(robot, axes, np.eye(4), np.eye(4)) for axes in KUKA_AXES)
    data = ["DEFDAT weld", *(f"DECL E6POS XP{k + 1}={p}" for k, p in enumerate(points) if k < 2)]
    data += [
        f"DECL FDAT FP{k}={{TOOL_NO {k},BASE_NO {k},IPO_FRAME #{mode}}}"
        for k, mode in ((2, "BASE"), (3, "TCP"))
    ]
    at = {k: f"XP{k} WITH $TOOL=$NULLFRAME, $BASE=$WORLD" for k in (1, 2)}
    program = ["DEF weld()", f"SLIN {at[1]}", f"SLIN {at[2]}", *lines, "END", *more]
    return write_pair(folder, "\n".join(program), "\n".join([*data, "ENDDAT"]))


@pytest.mark.parametrize(
    ("lines", "numbers"),
    {
        ("LOOP", "FDAT_ACT=FP2", "BAS(#CP_PARAMS,1)", f"LIN {POSE}", "ENDLOOP"): "22",
        (f"SLIN {POSE} WITH $BASE=BASE_DATA[3],$TOOL=TOOL_DATA[2]", f"LIN {POSE}"): "23 00",
        (f"SLIN {POSE} WITH $VEL=F(1, ,2), $TOOL=STOOL2(FP2) C_SPL", f"LIN {POSE}"): "20 00",
        (f"SLIN {POSE} WITH $BASE=SBASE(FP2.BASE_NO), $TOOL={{X 5,Y 0,Z 0,A 0,B 0,C 0}}",): "52",
        (f"SLIN {POSE} WITH $BASE=MYBASE", "DECL FRAME MYBASE={X 7,Y 0,Z 0,A 0,B 0,C 0}"): "07",
        ("SLIN F1 WITH $TOOL=TOOL_DATA[2], $BASE=BASE_DATA[1]", f"DECL FRAME F1={POSE}"): "21",
        ("SPLINE WITH $TOOL=STOOL2(FP2)", f"SPL {POSE}", f"SPL {POSE} WITH $TOOL=TOOL_DATA[3]",
         f"SPL {POSE}", "ENDSPLINE", f"LIN {POSE}"): "20 30 20 00",
    }.items(),
)  # fmt: skip
def test_motions_of_krl_have_the_tool_and_base_that_they_state(
    tmp_path: Path, lines: tuple[str, ...], numbers: str
) -> None:
    targets = read_programs(krl_of(tmp_path, list(lines)), OTHER_TOOLS)[0].targets
    frames = [(target.setup.tool[0, 3], target.setup.frame[0, 3]) for target in targets]
    assert " ".join(f"{1e3 * tool:.0f}{1e3 * base:.0f}" for tool, base in frames) == numbers
    assert {tuple(n.value for n in target.configuration) for target in targets} == {(2.0, 2.0)}


@pytest.mark.parametrize(
    ("lines", "place", "message"),
    [
        (["FDAT_ACT=FP2", f"LIN {POSE}", f"LIN {POSE}"], 6, r"\$TOOL of this motion is that of an"),
        (["FDAT_ACT=FP2", "L:", f"LIN {POSE}"], 6, r"\$TOOL of this motion is that of an earlier"),
        (["IF X THEN", "FDAT_ACT=FP2", "ENDIF", f"PTP {AXIS_POINT}"], 7, r"\$TOOL of this motion"),
        (["FDAT_ACT=FP2", f"LIN {POSE}", f"SLIN {POSE} WITH $TOOL=TOOL_DATA[1]"], 6, r"\$BASE of"),
        (["INTERRUPT DECL 3 WHEN $IN[1] DO OWN()", "FDAT_ACT=FP2", f"LIN {POSE}"], 4,
         "OWN may be called at any time"),
    ],
)  # fmt: skip
def test_a_tool_or_base_of_krl_that_another_line_puts_in_force_is_refused(
    tmp_path: Path, lines: list[str], place: int, message: str
) -> None:
    path = krl_of(tmp_path, lines, "DEF OWN()", "END")
    with pytest.raises(InputError, match=rf"weld.src:{place}: {message}"):
        read_programs(path, OTHER_TOOLS)


def test_a_tool_of_krl_that_nobody_stated_is_asked_for_by_its_number(tmp_path: Path) -> None:
    path = write_pair(tmp_path, *src(load_robot("kr10_r1100")))
    with pytest.raises(InputError, match=r"\$TOOL \(number 1\) is not stated .*--tool 1=X"):
        read_programs(path, NONE)
    path.write_text(f"DEF weld()\nLIN {POSE}\nEND\n")
    with pytest.raises(InputError, match=r"\$BASE \(number not stated\) .* --frame X,Y,Z"):
        read_programs(path, replace(NONE, tools=UNNAMED.tools))


def test_the_tool_of_a_krl_motion_has_the_name_of_its_number_where_it_states_one(
    tmp_path: Path,
) -> None:
    lines = [
        f"SLIN {POSE} WITH $TOOL=TOOL_DATA[2]",
        "SLIN F1 WITH $TOOL={X 5,Y 0,Z 0,A 0,B 0,C 0}, $BASE=BASE_DATA[1]",
        f"DECL FRAME F1={POSE}",
    ]
    targets = read_programs(krl_of(tmp_path, lines), OTHER_TOOLS)[0].targets
    assert [target.setup.tool_name for target in targets] == ["tool 2", "$TOOL"]


def test_a_load_of_krl_is_that_of_the_tool_that_a_motion_states(tmp_path: Path) -> None:
    lines = ["$LOAD={M 5,CM {X 0,Y 0,Z 100,A 0,B 0,C 0}}", "FDAT_ACT=FP2", f"PTP {AXIS_POINT}"]
    targets = read_programs(krl_of(tmp_path, lines), OTHER_TOOLS)[0].targets
    assert [target.setup.load for target in targets] == [(2.0, 0.0, 0.0, 0.0)]


def test_calls_of_other_files_of_krl_kept_points_and_external_axes_are_named(
    tmp_path: Path,
) -> None:
    poses = [f"LIN {POSE[:-1]},E1 {value},E2 0}}" for value in ("0.0", "500", "600")]
    lines = ["GRIP(1)", "OWN()", f"DECL AXIS XP={AXIS_POINT}", "PTP XP", "PTP XHOME", *poses]
    path = krl_of(tmp_path, lines, "DEF OWN()", f"PTP {AXIS_POINT}", "END")
    notes = read_programs(path, replace(OTHER_TOOLS, keep=frozenset(("xp", "xhome"))))[0].notes
    assert notes == (
        "GRIP is not in the file: its targets stay as they are, and a tool or base that it sets is "
        "not seen",
        "XP has constant values here and is corrected (--keep)",
        "XHOME stays as it is (--keep)",
        "E1 of poses is not 0 (first in line 10): it is taken to move neither the robot nor a "
        "base; state the targets as axis angles if it does",
    )


def pdl2(move: str = "") -> str:
    return "\r\n".join(
        [
            "PROGRAM weld PROG_ARM = 1", "VAR home : JOINTPOS FOR ARM[1] -- {1, 2}",
            "BEGIN", "  home := {0, -10, -10, 0, 60, 0}", "  MOVE TO home",
            "  MOVEFLY JOINT TO {10.5, -5, -5, 10, 50, 20} ADVANCE", move,
            "  MOVE JOINT TO home WITH $PROG_SPD_OVR = 50", "END weld", "",
        ]
    )  # fmt: skip


def test_joint_positions_of_pdl2_are_corrected_wherever_they_stand(
    tmp_path: Path, result: Result
) -> None:
    text = pdl2()
    done = corrected(tmp_path / "weld.pdl", text, result)
    assert without_numbers(done.text) == without_numbers(text)
    assert [target.line for target in done.program.targets] == [4, 6]
    assert "{1, 2}" in done.text


def test_elements_of_arrays_of_pdl2_are_targets_until_one_is_computed(tmp_path: Path) -> None:
    path = tmp_path / "weld.pdl"
    lines = "  p[1] := JNTP(0, -10, -10, 0, 30, 0)\r\n  MOVE ARM[1] TO p[1]"
    path.write_text(pdl2(lines))
    assert len(read_programs(path, NONE)[0].targets) == 3
    path.write_text(pdl2(f"{lines}\r\n  p[i] := other"))
    with pytest.raises(InputError, match=r":9: p is assigned or used outside of MOVE"):
        read_programs(path, NONE)


def test_a_kept_target_with_constant_values_is_named_as_corrected(tmp_path: Path) -> None:
    """It was once said to stay as it is, yet its numbers changed."""
    path = tmp_path / "weld.pdl"
    path.write_text(pdl2("  MOVE TO far"))
    notes = read_programs(path, replace(NONE, keep=frozenset(("home", "far"))))[0].notes
    assert notes == (
        "home has constant values here and is corrected (--keep)",
        "far stays as it is (--keep)",
    )


def test_the_command_writes_the_program_and_says_what_changed_most(
    tmp_path: Path, result: Result
) -> None:
    program = tmp_path / "weld.mod"
    program.write_bytes(module(result.robot).encode("latin-1"))
    code, out, err = ballbar("correct", program, "--with", result.file, "--json")
    assert code == 0
    data = json.loads(out)
    assert data["files"] == [str(tmp_path / "weld-corrected.mod")]
    assert {t["name"] for t in data["targets"]} >= {"p10", "p20", "home", "row{1}", "MoveC"}
    assert max(t["position_error_m"] for t in data["targets"]) > 1e-3
    assert "Schwei\xdfen".encode("latin-1") in (tmp_path / "weld-corrected.mod").read_bytes()
    words = ("correct", program, "--with", result.file, "--out", tmp_path / "b.mod")
    code, out, _ = ballbar(*words, "--payload", "tool0=1")
    assert code == 0
    assert "largest changes" in out
    assert "payload" not in out, "of both tools it is known"
    code, _, err = ballbar("correct", program, "--with", result.file)
    assert code == 2
    assert "exists already; nothing was written" in err


HOSTILE = (
    b"\0\0", b"MODULE m\nMoveL", b"MoveL [[[[[[", b'"', b"CONST robtarget", b"PERS tooldata t:=",
    b"CONST robtarget p{2", b"MoveL p,v,z,;", b"p := " + 3000 * b"[", b"MoveL [[-\n10,0,0]]",
    b"MoveL " + 3000 * b"[", b"CONST robtarget p:=" + 3000 * b"[",
)  # fmt: skip


@pytest.mark.parametrize("content", HOSTILE)
@pytest.mark.parametrize("suffix", [".mod", ".src", ".pdl"])
def test_hostile_text_is_refused_or_has_no_targets(
    tmp_path: Path, content: bytes, suffix: str
) -> None:
    path = tmp_path / f"hostile{suffix}"
    path.write_bytes(content)
    with suppress(InputError):  # nothing else may come out, however the text goes on
        (program,) = read_programs(path, NONE)
        assert program.targets == ()


def test_options_that_are_not_understood_are_refused() -> None:
    with pytest.raises(InputError, match=r"--tool 1,2: expected \[NAME=\]X,Y,Z,A,B,C"):
        frame_options(("1,2",), (), (), ())
    with pytest.raises(InputError, match="expected a finite mass, 0 or more"):
        frame_options((), (), ("-1",), ())
    with pytest.raises(InputError, match=r"--payload 1,2: expected"):
        frame_options((), (), ("a=1,2",), ())
    assert flange(load_robot("irb2400"), np.zeros(6))[0, 3] == pytest.approx(0.94)


@pytest.mark.parametrize(
    ("text", "unit", "new"),
    [
        ("12.5", "mm", "12.600"),
        ("12.50000", "mm", "12.60000"),  # as many decimals as the program has
        ("1.25E1", "mm", "12.600"),
        ("12.50000E0", "deg", "12.6000"),
        ("12", "1", "12.10000000"),
    ],
)
def test_a_number_that_changes_keeps_its_decimals(text: str, unit: str, new: str) -> None:
    number = Number(text, 0, len(text), 1)
    assert number_text(number, number.value, number.value + 0.1, unit) == new
    assert number_text(number, 7.0, 7.0 + 4e-9, unit) == text
