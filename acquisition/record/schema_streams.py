"""Script 5 of a record: paths, and what was recorded along them.

    pose.waypoints   where a path goes on to from the pose of its row, JSON list of joints, deg; NULL for a pose
    chunk            append-only: less than a second of one stream of an attempt at a path

A chunk holds `samples` samples from number `first` (from 0) of its stream on, as little-endian doubles: device clock
(s), arrival (s of the campaign), how many were lost before this one, 1 where it is doubted, then joints (deg) of the
robot or x, y, z (mm, own frame) of the instrument. `lost`: before any of them; `until_t_s`: device clock of the last.
The last chunk of an attempt says where its stream ends, and the attempt whether that is the end of the path.
"""

from __future__ import annotations

SCRIPT = """
ALTER TABLE pose ADD COLUMN waypoints TEXT;
DROP TRIGGER plan_fixed;
CREATE TRIGGER plan_fixed BEFORE UPDATE OF id, visit, name, kind, set_name, block, target, base_target, joints_deg,
  sides, approach_deg, waypoints ON pose
  BEGIN SELECT RAISE(ABORT, 'a planned reading never changes'); END;
CREATE TABLE chunk (
  id INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
  attempt INTEGER NOT NULL REFERENCES attempt (id),
  role TEXT NOT NULL CHECK (role IN ('robot', 'instrument')),
  first INTEGER NOT NULL,
  samples INTEGER NOT NULL CHECK (samples > 0),
  lost INTEGER NOT NULL,
  from_t_s REAL NOT NULL,
  until_t_s REAL NOT NULL,
  arrived_t_s REAL NOT NULL,
  data BLOB NOT NULL,
  checksum TEXT
) STRICT;
CREATE INDEX chunks_of_attempt ON chunk (attempt, role, first);
CREATE TRIGGER chunk_fixed BEFORE UPDATE ON chunk WHEN old.checksum IS NOT NULL
  BEGIN SELECT RAISE(ABORT, 'what was recorded never changes'); END;
CREATE TRIGGER chunk_kept BEFORE DELETE ON chunk
  BEGIN SELECT RAISE(ABORT, 'what was recorded is never deleted'); END;
CREATE INDEX waypoints_reached ON event (id) WHERE kind = 'waypoint';
"""
