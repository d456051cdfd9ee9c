"""The routes: what answers under which path."""
