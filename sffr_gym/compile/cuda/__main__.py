"""Compile threads: ``python -m sffr_gym.compile.cuda REQUEST TARGET FILE``, in a process of its own.

REQUEST is a file with pickled :class:`described.Thread`; TARGET is a device's capability such as ``sm_90``, for which
FILE gets PTX, or ``host``, for which it gets a shared object.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Sequence
from pathlib import Path

from sffr_gym.compile.builder.emission import link
from sffr_gym.compile.builder.frontend import register_kernels
from sffr_gym.compile.cuda.emission import to_object, to_ptx
from sffr_gym.compile.cuda.program import find_libdevice
from sffr_gym.compile.cuda.thread import ThreadFrontend
from sffr_gym.compile.library import HOST


def main(arguments: Sequence[str]) -> int:
    """Compile what was asked for."""
    request, target, file = arguments
    threads = pickle.loads(Path(request).read_bytes())
    register_kernels()
    frontend = ThreadFrontend(on_device=target != HOST)
    for thread in threads:
        frontend.add_thread(thread)
    module = frontend.module()
    if target == HOST:
        link([to_object(module)], Path(file))
    else:
        Path(file).write_text(to_ptx(module, {thread.name for thread in threads}, target, find_libdevice()))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
