"""Piecewise-affine systems solved exactly, from event to event; nothing here knows of robots."""

from armsim.exact.piecewise_affine import System

__all__ = ["System"]
