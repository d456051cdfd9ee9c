"""Reference bridge: MBP/1 for a tracker, to be filled in with calls of a vendor's SDK.

It is one file that needs only the standard library of Python 3.10 or later. Replace `Still` by a class with the
same methods that call the SDK, then run `python bridge.py [port]`.
The rest is the protocol and can stay: the lines and their sums, one client at a time, long commands
that ABORT can end, the client that falls silent. `docs/bridge.md` is the page that belongs to it.
"""

import contextlib
import math
import re
import select
import socket
import sys
import threading
import time

SILENCE_S = 30.0
MAKER = {"vendor": "Example", "model": "Still", "serial": "0", "fw": "0", "sim": 1}


class Refusal(Exception):
    """Refusal for the client: code of docs/bridge.md, sentence, and whether a retry may help."""

    def __init__(self, code, text, retry=False):
        super().__init__(text)
        self.code, self.text, self.retry = code, text.replace('"', "'"), retry


class Still:
    """A tracker whose SMR is always in the same place. Units are mm, deg, degC, hPa and s.

    Methods may raise Refusal; any other exception becomes code 501 with its text.
    """

    place = (1000.0, 2000.0, 300.0)

    def state(self):
        """OFF, WARMING, READY, ERROR or ESTOP. BUSY is added by the bridge."""
        return "READY"

    def weather(self):
        """T, P, H of the weather station. Raise Refusal(204, ...) without one."""
        return 20.0, 1013.25, 50.0

    def initialise(self):
        """Until the instrument is READY."""

    def configure(self, command, fields):
        """MODE and TARGET: set the SDK, return what is in force now."""
        return {"type": fields["type"], "d": float(fields["d"])} if command == "TARGET" else {}

    def point(self, x, y, z, radius):
        """Aim there and lock on the nearest SMR; raise Refusal(310, ..., retry=True) otherwise."""
        if math.dist((x, y, z), self.place) > radius:
            raise Refusal(310, "no target there", retry=True)

    def measure(self, samples, rate, cancelled):
        """Average `samples` readings of ONE measurement: place and scatter per axis. Look at `cancelled` often.

        Take place, time and status from the same result of the SDK: three calls are three readings.
        """
        if cancelled.wait(samples / rate):
            raise Refusal(110, "aborted")
        return self.place, (0.01, 0.01, 0.01)


def crc(data):
    """CRC-16/CCITT-FALSE; "123456789" gives 29B1."""
    value = 0xFFFF
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = ((value << 1) ^ 0x1021 if value & 0x8000 else value << 1) & 0xFFFF
    return value


def fields_of(text):
    return dict(word.split("=", 1) for word in text.split() if "=" in word)


def text_of(fields):
    return "".join(
        f" {key}={value!r}" if isinstance(value, float) else f" {key}={value}"
        for key, value in fields.items()
    )


class Bridge:
    """Serves one client after another. `listen` returns the port; `serve` runs until `close`."""

    def __init__(self, device):
        self.device = device
        self.client = None
        self.cancelled = threading.Event()
        self.job = None
        self.sending = threading.Lock()
        self.server = None
        self.closing = threading.Event()

    def listen(self, port=5701, host="127.0.0.1"):
        self.server = socket.create_server((host, port))
        return self.server.getsockname()[1]

    def serve(self):
        while True:
            try:
                client, _ = self.server.accept()
            except OSError:
                return  # closed
            if self.client is None:
                self.client = client
                if self.closing.is_set():  # it came while `close` looked for one
                    client.close()
                    return
                threading.Thread(target=self.converse, args=(client,), daemon=True).start()
            else:
                threading.Thread(target=self.turn_away, args=(client,), daemon=True).start()

    def close(self):
        self.closing.set()
        for each in (self.server, self.client):
            if each is not None:
                with contextlib.suppress(OSError):  # the client has gone by itself meanwhile
                    each.shutdown(socket.SHUT_RDWR)
        self.server.close()

    def turn_away(self, client):
        with client:
            client.settimeout(SILENCE_S)
            number = client.recv(512).split(b" ")[0].decode("ascii", "replace")
            client.sendall(self.line(f'{number} ERR code=120 text="in use" retry=1'))

    def converse(self, client):
        buffer = b""
        try:
            while True:
                if not select.select([client], [], [], SILENCE_S)[0]:
                    return  # silent for too long
                data = client.recv(4096)
                if not data:
                    return
                buffer += data
                while b"\n" in buffer:
                    line, buffer = buffer.split(b"\n", 1)
                    self.take(line.rstrip(b"\r"))
                if len(buffer) > 512:
                    return
        except OSError:
            return
        finally:
            self.cancelled.set()  # nobody listens: stop what moves
            job, self.job = self.job, None
            if job is not None:
                job.join()
            client.close()
            self.client = None

    # -- one request --------------------------------------------------------------------------------------

    def take(self, line):
        """Discard a line with a wrong sum; answer any other with its own number."""
        found = re.fullmatch(rb"(.*)\*([0-9A-Fa-f]{4})", line)
        if found and int(found[2], 16) != crc(found[1]):
            return
        body = (found[1] if found else line).decode("ascii", "replace")
        request = re.fullmatch(r"(\d{1,10}) ([A-Z_]+)(?: (.*))?", body)
        if request is None:
            self.send('0 ERR code=101 text="not a request" retry=0')
            return
        number, command, fields = request[1], request[2], fields_of(request[3] or "")
        if command in ("INIT", "POINT", "MEASURE"):
            if self.busy():
                self.send(f'{number} ERR code=110 text="busy" retry=1')
                return
            self.cancelled.clear()
            self.send(f"{number} ACK eta=1.0")
            self.job = threading.Thread(
                target=self.answer, args=(number, self.long, command, fields), daemon=True
            )
            self.job.start()
        else:
            self.answer(number, self.short, command, fields)

    def busy(self):
        job = self.job
        return job is not None and job.is_alive()

    def answer(self, number, act, command, fields):
        try:
            reply = f"{number} OK" + text_of(act(command, fields))
        except Refusal as refusal:
            reply = f'{number} ERR code={refusal.code} text="{refusal.text}" retry={int(refusal.retry)}'
        except (KeyError, ValueError) as error:
            reply = f'{number} ERR code=103 text="{type(error).__name__}" retry=0'
        except Exception as error:  # noqa: BLE001  whatever the SDK throws is answered, and the bridge lives on
            text = str(error).replace('"', "'").replace("\n", " ")[:200]
            reply = f'{number} ERR code=501 text="{text}" retry=0'
        if threading.current_thread() is self.job:
            self.job = None  # first: the client may ask again as soon as it has read the reply
        self.send(reply)

    def short(self, command, fields):
        if command == "HELLO":
            if fields.get("proto") != "1":
                raise Refusal(103, "proto=1 only")
            return {
                "proto": 1,
                "kind": "TRACKER",
                **MAKER,
                "bridge": "1.0",
                "crc": 1,
                "units": "mm,deg,C,hPa",
            }
        if command == "STATUS":
            state = self.device.state()
            return {"state": "BUSY" if self.busy() and state == "READY" else state}
        if command == "WEATHER":
            return dict(zip("TPH", self.device.weather(), strict=True))
        if command in ("MODE", "TARGET"):
            return self.device.configure(command, fields)
        if command == "ABORT":
            self.cancelled.set()
            return {}
        if command in ("PING", "CLEAR", "BYE"):
            return {}
        raise Refusal(102, f"unknown command {command}")

    def long(self, command, fields):
        if command == "INIT":
            self.device.initialise()
            return {}
        self.check_ready()
        if command == "POINT":
            self.device.point(*(float(fields[key]) for key in "xyz"), float(fields.get("radius", 30.0)))
            return {"found": 1}
        samples, rate = int(fields["samples"]), float(fields["rate"])
        if samples < 1 or not rate > 0:
            raise Refusal(103, "samples or rate out of range")
        place, scatter = self.device.measure(samples, rate, self.cancelled)
        taken = time.monotonic()
        self.check_ready()
        t, p, h = self.device.weather()
        answer = dict(zip(("x", "y", "z", "sx", "sy", "sz"), (*place, *scatter), strict=True))
        answer |= {"n": samples, "t": taken, "age": time.monotonic() - taken, "status": 0}
        return answer | {"temp": t, "P": p, "H": h, "face": fields.get("face", "1")}

    def check_ready(self):
        codes = {"OFF": 201, "WARMING": 202, "ERROR": 201, "ESTOP": 610}
        state = self.device.state()
        if state in codes:
            raise Refusal(codes[state], f"instrument is {state}", retry=True)

    def line(self, text):
        body = text.encode("ascii", "replace")
        return body + b"*%04X\n" % crc(body)

    def send(self, text):
        client = self.client
        if client is not None:
            with self.sending:
                try:
                    client.sendall(self.line(text))
                except OSError:
                    return  # the client is gone; `converse` will notice


if __name__ == "__main__":
    bridge = Bridge(Still())
    sys.stdout.write(
        f"listening on 127.0.0.1:{bridge.listen(int(sys.argv[1]) if len(sys.argv) > 1 else 5701)}\n"
    )
    bridge.serve()
