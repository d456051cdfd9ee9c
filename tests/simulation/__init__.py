"""Histories of a cell and its service from one seed, on one thread, with drawn faults.

Importing this package replaces Python's modules of time, threads and sockets for our own packages, in this interpreter
and for good. Only `python -m tests.simulation` does so.
"""

from tests.simulation.modules import install

install()
