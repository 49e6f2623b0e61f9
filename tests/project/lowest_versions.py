"""Constraints for pip: the lowest version that pyproject allows of each requirement of the product.

    python -m tests.project.lowest_versions > lowest.txt

Packages that the requirements need in turn, and the tools of docs and tests, are left to pip.
"""

from __future__ import annotations

import tomllib

from packaging.requirements import Requirement

from tests.helpers.source_imports import ROOT


def lowest() -> list[str]:
    """Lines `name==version`."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    groups = (project["dependencies"], *(extras[name] for name in ("ads", "dask", "ros")))
    requirements = [Requirement(text) for group in groups for text in group]
    return [
        f"{requirement.name}=={bound.version}"
        for requirement in requirements
        for bound in requirement.specifier
        if bound.operator == ">="
    ]


if __name__ == "__main__":
    print(*lowest(), sep="\n")
