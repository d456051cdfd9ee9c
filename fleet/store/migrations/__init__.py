"""The history of the tables of a store: one file per step in `versions`.

A step never changes once a store has seen it.
"""
