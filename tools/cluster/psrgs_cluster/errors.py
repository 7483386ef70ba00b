"""Failures that are told apart. Each has its message alone as argument, so that it travels between machines."""

from __future__ import annotations


class PlanProblem(Exception):
    """The plan, the photographs or the disk beside the driver cannot be used: no other machine helps."""


class BlockProblem(Exception):
    """The program refuses a block for reasons that hold on every machine."""


class NodeProblem(Exception):
    """A machine cannot train any block: another machine may."""


class Interruption(Exception):
    """The training of a block ended early: it goes on from its last checkpoint."""
