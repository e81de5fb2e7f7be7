"""List the packages to install: the repository root is `perfanim`. All else stands in pyproject.toml."""

from setuptools import find_packages, setup

setup(packages=["perfanim", *(f"perfanim.{name}" for name in find_packages(include=["core*", "perfanim_addon*"]))])
