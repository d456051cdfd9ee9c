"""`python -m tests.fuzz [SECONDS [NAME]]`: spoil files of every format in turn.

The program runs until the time is over. It prints every fault once, with the seed that reproduces it, and the
number of cases. Exit code 1 if there was a fault, or if a file took longer than `SLOW_S`.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path
from random import Random

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from calib.errors import DataError
from drivers.errors import ConfigError
from tests.fuzz.formats import Format, formats

SLOW_S = 10.0  # of processor time, for the examples' some kilobytes


def fault_of(format_: Format, path: Path, seed: int) -> str:
    """Describe the fault of the reader for a file spoiled by `seed`; empty without a fault."""
    rng = Random(seed)
    path.write_bytes(rng.choice(format_.spoil)(format_.good, rng))
    begin = time.process_time()
    try:
        format_.read(path)
    except (DataError, ConfigError):
        pass
    except Exception as error:  # noqa: BLE001 - a fault of any kind is what is looked for
        last = traceback.extract_tb(error.__traceback__)[-1]
        ours = [
            each for each in traceback.extract_tb(error.__traceback__) if "site-packages" not in each.filename
        ]
        where = f"{Path(ours[-1].filename).name}:{ours[-1].lineno}"
        return f"{type(error).__name__} at {where} ({Path(last.filename).name}): {str(error)[:100]}"
    finally:
        path.write_bytes(format_.good)
    return "slow" if time.process_time() - begin > SLOW_S else ""


def main() -> int:
    """Run for the requested time; return 0 if nothing was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("seconds", nargs="?", type=float, default=3600.0)
    parser.add_argument("name", nargs="?")
    parser.add_argument("--seed", type=int, default=time.time_ns(), help="of the first case")
    options = parser.parse_args()
    warnings.simplefilter("error")
    tried, found = Counter[str](), Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        known = formats(Path(folder))
        names = [options.name] if options.name else list(known)
        end, seed = time.monotonic() + options.seconds, options.seed
        while time.monotonic() < end:
            for name in names:
                fault = fault_of(known[name], Path(folder) / name, seed)
                tried[name] += 1
                key = f"{name}: {fault.partition(': ')[0]}"
                if fault and key not in found:
                    print(f"{name}, seed {seed}: {fault}", flush=True)
                found[key] += bool(fault)
            seed += 1
    print(f"{sum(tried.values())} cases, {min(tried.values())} or more of each format: ", end="")
    print(f"{sum(map(bool, found.values()))} kinds of fault")
    return 1 if any(found.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
