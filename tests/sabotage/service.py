"""Changes to the HTTP service."""

from __future__ import annotations

from tests.sabotage.change import Change

_HTTP = (
    "tests/service/test_http.py",
    "tests/service/test_http_parts.py",
    "tests/service/test_http_data.py",
)

_LEASE = (
    "tests/service/test_http_parts.py",
    "tests/service/test_motion_lease.py",
    "tests/service/test_roles.py",
    "tests/service/test_http.py",
)

CHANGES = (
    Change(
        "service/programs/kuka.py",
        "        if name not in self._met:\n            try:",
        "        if True:\n            try:",
        "a KUKA point declared n times and used n times costs n squared",
        ("tests/service/test_programs_hostile.py",),
    ),
    Change(
        "service/programs/compensation.py",
        "model.robot.joints >= 6 or",
        "True or",
        "the flange of a SCARA lands where its tool should",
        ("tests/service/test_machines_driven.py",),
    ),
    Change(
        "service/programs/target_table.py",
        "driven.joints / self._robot.joint_units",
        "np.degrees(driven.joints)",
        "the mm of a slide are written as if they were rad",
        ("tests/service/test_machines_driven.py",),
    ),
    Change(
        "service/http/routes/runs/plan_routes.py",
        "    here.lease.needed(lease_id)\n",
        "",
        "the robot goes back to a pose that somebody without the lease wants again",
        ("tests/service/test_http_plans.py",),
    ),
    Change(
        "service/static/prompt.js",
        "setTimeout(() => { if (asked === prompt.id) { armed = asked; dress(); } }, ARMED_MS);",
        "armed = asked;",
        "a key that was meant for one question answers the next",
        ("tests/service/test_operator_page.py",),
    ),
    Change(
        "service/http/state.py",
        "limiter=self._stoppers",
        "limiter=self._waiters",
        "a hundred clients that wait keep a stop from being heard",
        ("tests/service/test_urgent.py",),
    ),
    Change(
        "service/http/access/roles.py",
        "        operator = hmac.compare_digest(given, self.operator.encode())",
        "        operator = self.operator.encode().startswith(given)",
        "the first character of the token, or none, opens the service",
        _LEASE,
    ),
    Change(
        "service/http/access/roles.py",
        "/[^/]+/(pause|stop)",
        "/[^/]+/(pause|stop|resume)",
        "whoever may only look makes the robot move",
        _LEASE,
    ),
    Change(
        "service/http/access/motion_lease.py",
        "            _prove(held, lease_id)\n            return held\n",
        "            return held\n",
        "a robot moves by the lease of somebody else",
        _LEASE,
    ),
    Change(
        "service/http/access/motion_lease.py",
        "            _prove(held, lease_id)\n            if held.holder != holder:",
        "            if held.holder != holder:",
        "whoever repeats the holder's name prolongs, and is given, their lease",
        _LEASE,
    ),
    Change(
        "service/http/access/motion_lease.py",
        "                _prove(held, lease_id)\n            self._held = None",
        "                pass\n            self._held = None",
        "anybody gives back the lease of another",
        _LEASE,
    ),
    Change(
        "service/http/access/motion_lease.py",
        "            if (held := self._live()) is not None:\n                raise _other(held)\n",
        "            held = self._live()\n",
        "a second client takes the lease without a word",
        _LEASE,
    ),
    Change(
        "service/http/access/motion_lease.py",
        '        self._audit.note(f"lease {how}", holder=holder, seconds=seconds, **more)\n',
        "",
        "nobody can say later who took the lease from whom",
        _LEASE,
    ),
    Change(
        "service/private.py",
        "os.open(name, flags, 0o600)",
        "os.open(name, flags, 0o644)",
        "everybody on the computer reads the token",
        ("tests/service/test_roles.py", "tests/service/test_motion_lease.py"),
    ),
    Change(
        "service/http/access/gate.py",
        "        if origin is not None and urlsplit(origin)",
        "        if origin == host and urlsplit(origin)",
        "a page from elsewhere in the operator's browser commands the robot",
        _HTTP,
    ),
    Change(
        "service/http/access/gate.py",
        "            return False  # a name that",
        "            return True  # a name that",
        "a name that somebody lets point at us is answered",
        _HTTP,
    ),
    Change(
        "service/http/access/gate.py",
        "            if seen > self._most:",
        "            if seen > 100 * self._most:",
        "a body without a declared length is never too large",
        _HTTP,
    ),
    Change(
        "service/http/work/idempotency.py",
        "        if entry.fingerprint != asked:",
        "        if not entry.fingerprint:",
        "the answer to another request is given for this one",
        _HTTP,
    ),
    Change(
        "service/http/work/idempotency.py",
        "        os.fsync(self._journal.fileno())\n",
        "",
        "after a power cut a request that was begun is done a second time",
        _HTTP,
    ),
    Change(
        "service/http/work/idempotency.py",
        '            self._write(what="begun", key=key, fingerprint=entry.fingerprint)\n',
        "",
        "after a crash a request that was begun is done a second time",
        _HTTP,
    ),
    Change(
        "service/names.py",
        "    return _SAFE.fullmatch(name) is not None",
        "    return _SAFE.match(name) is not None",
        "an id in a URL leads out of its folder",
        _HTTP,
    ),
    Change(
        "service/http/work/jobs.py",
        "            if len(self._waiting) >= MOST_WAITING:",
        "            if len(self._waiting) > 100 * MOST_WAITING:",
        "the queue of jobs grows without end",
        ("tests/service/test_refused_politely.py",),
    ),
    Change(
        "service/http/routes/runs/run_routes.py",
        "at_once=True, problems=problems)",
        "at_once=True, problems=[])",
        "whoever stops is not told what could not be stopped",
        ("tests/service/test_refused_politely.py",),
    ),
    Change(
        "service/http/work/workers.py",
        "            process_group=0,  #",
        "            start_new_session=True,  #",
        "workers take the processors from a service that has to hear a stop",
        ("tests/service/test_priority.py",),
    ),
    Change(
        "service/http/server.py",
        "        gc.freeze()\n",
        "",
        "a stop waits until all that is loaded was looked through for garbage",
        ("tests/service/test_priority.py",),
    ),
    Change(
        "service/http/runs/book.py",
        ", foresee=self.foresee)",
        ")",
        "a run reads its whole plan in the process that has to hear a stop",
        ("tests/service/test_forecasts.py",),
    ),
)
