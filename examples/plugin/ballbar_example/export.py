"""The robot for MATLAB's Robotics Toolbox (Corke)."""

from ballbar.export.result import Result, noted_text, number
from ballbar.export.rows import standard_rows
from ballbar.export.tables import without_negligible_angles


def matlab(result: Result) -> str:
    """A script that makes `robot`, below the notes of the result."""
    chain, dropped = without_negligible_angles(result)
    rows, links = standard_rows(chain), []
    for row in zip(rows.d, rows.a, rows.alpha, rows.theta, strict=True):
        d, a, alpha, offset = map(number, row)
        links.append(f"  Link('d', {d}, 'a', {a}, 'alpha', {alpha}, 'offset', {offset})")
    tool = f"robot.tool = troty({number(rows.tool_beta)});"
    return noted_text(result, "%", dropped, ["robot = SerialLink([", *links, "]);", tool])
