"""A private server of PostgreSQL, from the system's packages, for as long as a test needs it."""

import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

PASSWORD = "not-to-be-shown"
UNPRIVILEGED = ("postgres", "nobody")  # users, one of whom the server belongs to where root runs the tests


def program(name):
    """Return where a program of the server lies, which is not always on the path."""
    places = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=lambda place: float(place.parent.name))
    return shutil.which(name) or next((str(p / name) for p in reversed(places) if (p / name).is_file()), None)


@contextmanager
def running_server():
    """Yield the address of an empty database; skips the test, with its reason, where there is no PostgreSQL."""
    psycopg = pytest.importorskip("psycopg", reason="the driver psycopg is not installed")
    if not (initdb := program("initdb")) or not (postgres := program("postgres")):
        pytest.skip("PostgreSQL is not installed: apt-get install postgresql")
    folder = Path(tempfile.mkdtemp(prefix="sffr-pg-"))  # short, for its socket, and open to another user
    as_user = {}
    if os.geteuid() == 0:
        known = {each.pw_name: each for each in pwd.getpwall()}
        owner = next(known[name] for name in UNPRIVILEGED if name in known)
        os.chown(folder, owner.pw_uid, owner.pw_gid)
        as_user = {"user": owner.pw_uid, "group": owner.pw_gid, "extra_groups": []}
    data, secret = folder / "data", folder / "secret"
    secret.write_text(PASSWORD)
    secret.chmod(0o644)
    made = [initdb, "-D", str(data), "-U", "tuner", "--auth=scram-sha-256", f"--pwfile={secret}", "-E", "UTF8", "-N"]
    quiet = {"cwd": folder, "stdout": subprocess.DEVNULL}
    subprocess.run([*made, "--locale=C"], check=True, **quiet, **as_user)
    port = free_port()
    started = [postgres, "-D", str(data), "-p", str(port), "-k", str(folder), "-c", "listen_addresses=127.0.0.1"]
    with open(folder / "log", "w") as log:
        server = subprocess.Popen([*started, "-c", "fsync=off"], stderr=log, **quiet, **as_user)
    where = f"tuner:{PASSWORD}@127.0.0.1:{port}"
    try:
        with connected(psycopg, f"postgresql://{where}/postgres", server, folder / "log") as connection:
            connection.execute("create database trials")
        yield f"postgresql+psycopg://{where}/trials"
    finally:
        server.send_signal(signal.SIGINT)  # does not wait for clients that are still connected
        server.wait(60)
        shutil.rmtree(folder, ignore_errors=True)


def free_port():
    """Return a port that nobody listens at."""
    with socket.socket() as asked:
        asked.bind(("127.0.0.1", 0))
        return asked.getsockname()[1]


def connected(psycopg, url, server, log, seconds=60.0):
    """Return a connection, once the server takes one."""
    end = time.monotonic() + seconds
    while True:
        try:
            return psycopg.connect(url, autocommit=True)
        except psycopg.OperationalError:
            if server.poll() is not None or time.monotonic() > end:
                raise AssertionError(log.read_text()) from None
            time.sleep(0.1)
