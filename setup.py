"""The folders beside `ballbar` are its packages: `ident/` is installed as `ballbar.ident`."""

from setuptools import find_packages, setup

FOLDERS = ("cell", "sim", "acquisition", "ident", "planning")

setup(
    packages=sorted(
        {*find_packages(include=["ballbar*"]), "ballbar.scenarios"}
        | {
            f"ballbar.{package}"
            for folder in FOLDERS
            for package in find_packages(include=[folder, f"{folder}.*"])
        }
    ),
    package_dir={f"ballbar.{folder}": folder for folder in (*FOLDERS, "scenarios")},
)
