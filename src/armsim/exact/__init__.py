"""Exact event-to-event solution of piecewise-affine systems, independent of the robot model."""

from armsim.exact.piecewise_affine import System

__all__ = ["System"]
