"""The tables of a record; `PRAGMA user_version` of its file is `VERSION`.

    campaign   one row: what was asked, the state, the world frame
    pose       one planned reading a row: a target in a visit of the robot to joint angles (none for a nest)
    attempt    append-only: written before the act (`open`), closed once by its outcome
    prompt     questions to a person and their answers
    command    what people and programs asked of the campaign
    event      what happened, in order; its id is the version of the record
    chunk      append-only: less than a second of one stream of an attempt at a path
    device     the individual robots and instruments it was measured with; `reason`: why another one was accepted

Plan, prompts, commands, attempts and events never change and are never deleted. Triggers refuse it, so that neither a
fault of this program nor a careless user can rewrite a measurement. A reading that is no longer trusted stays, and its
row of `pose` names the one that is measured in its place. An attempt of kind `arrive` is one approach; each `measure`
of a pose names the arrival on which it relies. A point has its coordinates, a pose its orientation as well (`rot_*`:
unit quaternion, instrument's frame), a distance its `length_mm` to `pose.base_target`. For `checksum` see
`record.seal`. `campaign.unsealed_*` is 0, except in a record that an early program converted from a version without
checksums; that is refused.

`pose.waypoints` has the further waypoints of a path as a JSON list of joints; NULL for a pose. A chunk holds `samples`
samples from number `first` (from 0) of its stream on, as little-endian doubles. Their columns are the device clock (s),
the arrival (s of the campaign), the number lost before this one, and 1 if it is doubted. Then follow the joints (deg)
of the robot or x, y, z (mm, own frame) of the instrument. `lost` is the number lost before any of them, `until_t_s` the
device clock of the last. The last chunk of an attempt marks the end of its stream, and the attempt states whether that
is the end of the path. `campaign.owner` is the program that may write; `station` counts the places of the instrument.
Angles are in deg, lengths in mm, times in s: `utc` since 1970, `t_s` since the start of the campaign. Joints are JSON
lists.
"""

from __future__ import annotations

VERSION = 5
UNSEALED = 3  # the last version whose rows had no checksums; a record of it may have been carried over to a later one
LAST_TO_READ_OLDER = "75d40299"
"""The commit that reads records of versions 1 to 4."""

SCRIPT = f"""
CREATE TABLE campaign (
  id TEXT NOT NULL PRIMARY KEY,
  one INTEGER NOT NULL DEFAULT 1 UNIQUE CHECK (one = 1),
  name TEXT NOT NULL,
  created_utc REAL NOT NULL,
  started_utc REAL,
  simulated INTEGER NOT NULL CHECK (simulated IN (0, 1)),
  cell TEXT NOT NULL,
  campaign TEXT NOT NULL,
  state TEXT NOT NULL CHECK (state IN ('draft', 'ready', 'running', 'waiting_for_operator', 'paused',
                                       'succeeded', 'failed', 'stopped')),
  reason TEXT NOT NULL DEFAULT '',
  world TEXT,
  owner TEXT,
  station INTEGER NOT NULL DEFAULT 1,
  checksum TEXT,
  unsealed_poses INTEGER NOT NULL DEFAULT 0,
  unsealed_attempts INTEGER NOT NULL DEFAULT 0,
  unsealed_devices INTEGER NOT NULL DEFAULT 0
) STRICT;
CREATE TRIGGER campaign_fixed BEFORE UPDATE OF id, name, created_utc, simulated, cell, campaign ON campaign
  BEGIN SELECT RAISE(ABORT, 'a campaign that was begun never changes'); END;

CREATE TABLE pose (
  id INTEGER NOT NULL PRIMARY KEY,
  visit INTEGER NOT NULL,
  name TEXT NOT NULL,
  kind TEXT NOT NULL CHECK (kind IN ('nest', 'pose')),
  set_name TEXT NOT NULL,
  block INTEGER NOT NULL,
  target TEXT NOT NULL,
  joints_deg TEXT NOT NULL,
  sides TEXT NOT NULL,
  approach_deg TEXT NOT NULL,
  status TEXT NOT NULL DEFAULT 'planned' CHECK (status IN ('planned', 'deferred', 'measured', 'skipped')),
  reason TEXT NOT NULL DEFAULT '',
  replaced_by INTEGER REFERENCES pose (id),
  base_target TEXT,
  checksum TEXT,
  waypoints TEXT
) STRICT;
CREATE INDEX poses_left ON pose (kind, status, visit);
CREATE INDEX poses_of_visit ON pose (visit);
CREATE TRIGGER plan_fixed BEFORE UPDATE OF id, visit, name, kind, set_name, block, target, base_target, joints_deg,
  sides, approach_deg, waypoints ON pose
  BEGIN SELECT RAISE(ABORT, 'a planned reading never changes'); END;
CREATE TRIGGER plan_kept BEFORE DELETE ON pose
  BEGIN SELECT RAISE(ABORT, 'a planned reading is never deleted'); END;
CREATE TRIGGER measured_stays BEFORE UPDATE OF status ON pose
  WHEN old.status = 'measured' AND new.status <> 'measured'
  BEGIN SELECT RAISE(ABORT, 'a reading that was measured stays measured'); END;
CREATE TRIGGER replaced_once BEFORE UPDATE OF replaced_by ON pose WHEN old.replaced_by IS NOT NULL
  BEGIN SELECT RAISE(ABORT, 'a reading is replaced once'); END;

CREATE TABLE device (
  id INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
  role TEXT NOT NULL CHECK (role IN ('robot', 'instrument')),
  maker TEXT NOT NULL,
  model TEXT NOT NULL,
  serial TEXT NOT NULL,
  firmware TEXT NOT NULL,
  protocol TEXT NOT NULL,
  accepted_by TEXT NOT NULL DEFAULT '',
  reason TEXT NOT NULL DEFAULT '',
  checksum TEXT
) STRICT;
CREATE TRIGGER device_kept BEFORE DELETE ON device
  BEGIN SELECT RAISE(ABORT, 'a device of the record is never deleted'); END;
CREATE TRIGGER device_fixed BEFORE UPDATE OF id, role, maker, model, serial ON device
  WHEN new.id <> old.id OR new.role <> old.role OR (old.maker <> '' AND new.maker <> old.maker)
    OR (old.model <> '' AND new.model <> old.model) OR (old.serial <> '' AND new.serial <> old.serial)
  BEGIN SELECT RAISE(ABORT, 'a device of the record never changes'); END;

CREATE TABLE attempt (
  id INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
  kind TEXT NOT NULL CHECK (kind IN ('arrive', 'measure')),
  visit INTEGER NOT NULL,
  pose INTEGER REFERENCES pose (id),
  arrival INTEGER REFERENCES attempt (id),
  status TEXT NOT NULL DEFAULT 'open' CHECK (status IN ('open', 'good', 'failed', 'died')),
  began_utc REAL NOT NULL,
  began_t_s REAL NOT NULL,
  ended_utc REAL,
  ended_t_s REAL,
  error_code INTEGER,
  error TEXT,
  raw BLOB,
  read_deg TEXT,
  tracker_x_mm REAL, tracker_y_mm REAL, tracker_z_mm REAL,
  world_x_mm REAL, world_y_mm REAL, world_z_mm REAL,
  std_x_mm REAL, std_y_mm REAL, std_z_mm REAL,
  samples INTEGER,
  device_t_s REAL,
  t_air_c REAL, pressure_hpa REAL, humidity_percent REAL,
  station INTEGER NOT NULL DEFAULT 1,
  rot_w REAL, rot_x REAL, rot_y REAL, rot_z REAL, rot_std_mrad REAL,
  world_rot_w REAL, world_rot_x REAL, world_rot_y REAL, world_rot_z REAL,
  visible_tool INTEGER, visible_base INTEGER,
  length_mm REAL, std_length_mm REAL, deviation_mm REAL, zero_mm REAL, battery_percent REAL,
  robot INTEGER REFERENCES device (id),
  instrument INTEGER REFERENCES device (id),
  checksum TEXT,
  CHECK (kind = 'arrive' OR pose IS NOT NULL),
  CHECK (kind = 'measure' OR (pose IS NULL AND arrival IS NULL)),
  CHECK (status <> 'good' OR kind = 'arrive' OR tracker_x_mm IS NOT NULL OR length_mm IS NOT NULL)
) STRICT;
CREATE UNIQUE INDEX one_good_reading ON attempt (pose) WHERE kind = 'measure' AND status = 'good';
CREATE INDEX attempts_open ON attempt (status) WHERE status = 'open';
CREATE TRIGGER attempt_closed BEFORE UPDATE ON attempt WHEN old.status <> 'open'
  BEGIN SELECT RAISE(ABORT, 'a closed attempt never changes'); END;
CREATE TRIGGER attempt_kept BEFORE DELETE ON attempt
  BEGIN SELECT RAISE(ABORT, 'an attempt is never deleted'); END;
CREATE TRIGGER reading_needs_arrival BEFORE INSERT ON attempt
  WHEN new.kind = 'measure' AND (SELECT kind FROM pose WHERE id = new.pose) = 'pose'
   AND NOT EXISTS (SELECT 1 FROM attempt AS a WHERE a.id = new.arrival AND a.kind = 'arrive'
                   AND a.status = 'good' AND a.visit = new.visit)
  BEGIN SELECT RAISE(ABORT, 'a reading needs its approach'); END;
CREATE TRIGGER measured_by_reading BEFORE UPDATE OF status ON pose
  WHEN new.status = 'measured' AND NOT EXISTS (SELECT 1 FROM attempt WHERE pose = new.id AND kind = 'measure'
                                               AND status = 'good')
  BEGIN SELECT RAISE(ABORT, 'only a good reading makes a planned one measured'); END;

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

CREATE TABLE prompt (
  id TEXT NOT NULL PRIMARY KEY,
  text TEXT NOT NULL,
  picture TEXT,
  expects TEXT NOT NULL,
  asked_utc REAL NOT NULL,
  answer TEXT,
  answered_by TEXT,
  answered_utc REAL,
  reason TEXT NOT NULL DEFAULT ''
) STRICT;
CREATE INDEX prompts_open ON prompt (id) WHERE answer IS NULL;
CREATE TRIGGER answer_fixed BEFORE UPDATE ON prompt WHEN old.answer IS NOT NULL
  BEGIN SELECT RAISE(ABORT, 'an answer never changes'); END;
CREATE TRIGGER prompt_kept BEFORE DELETE ON prompt
  BEGIN SELECT RAISE(ABORT, 'a prompt is never deleted'); END;

CREATE TABLE command (
  id INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
  utc REAL NOT NULL,
  verb TEXT NOT NULL,
  by TEXT NOT NULL,
  key TEXT UNIQUE
) STRICT;
CREATE TRIGGER command_fixed BEFORE UPDATE ON command
  BEGIN SELECT RAISE(ABORT, 'a command never changes'); END;
CREATE TRIGGER command_kept BEFORE DELETE ON command
  BEGIN SELECT RAISE(ABORT, 'a command is never deleted'); END;

CREATE TABLE event (
  id INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
  utc REAL NOT NULL,
  t_s REAL,
  kind TEXT NOT NULL,
  data TEXT NOT NULL
) STRICT;
CREATE INDEX readings ON event (id) WHERE kind = 'reading';
CREATE INDEX waypoints_reached ON event (id) WHERE kind = 'waypoint';
CREATE TRIGGER event_kept BEFORE DELETE ON event
  BEGIN SELECT RAISE(ABORT, 'an event is never deleted'); END;
CREATE TRIGGER event_fixed BEFORE UPDATE ON event
  BEGIN SELECT RAISE(ABORT, 'an event never changes'); END;

CREATE TRIGGER last_arrival BEFORE INSERT ON attempt
  WHEN new.arrival IS NOT NULL
   AND EXISTS (SELECT 1 FROM attempt AS a WHERE a.id > new.arrival AND a.kind = 'arrive')
  BEGIN SELECT RAISE(ABORT, 'the robot has gone elsewhere since that arrival'); END;
CREATE TRIGGER running BEFORE INSERT ON attempt WHEN (SELECT state FROM campaign) <> 'running'
  BEGIN SELECT RAISE(ABORT, 'nothing is attempted unless the campaign runs'); END;
CREATE TRIGGER prompt_answered BEFORE INSERT ON attempt
  WHEN EXISTS (SELECT 1 FROM prompt WHERE answer IS NULL)
  BEGIN SELECT RAISE(ABORT, 'nothing is attempted before the prompt is answered'); END;
PRAGMA user_version = {VERSION};
"""
