"""Files of POSIX shared memory: by posix_ipc, or, where that is not installed, by the standard library.

posix_ipc needs a C compiler where it has no wheel. `_posixshmem` is private to the standard library, so it is second.
"""

from __future__ import annotations

import os
from typing import Final

try:
    import posix_ipc
except ImportError:
    import _posixshmem

    _EXCLUSIVE: Final = os.O_RDWR | os.O_CREAT | os.O_EXCL

    def create(name: str) -> int:
        """The descriptor of a new, empty file; FileExistsError, OSError."""
        return int(_posixshmem.shm_open(name, _EXCLUSIVE, 0o600))

    def unlink(name: str) -> None:
        """Remove a file; FileNotFoundError, OSError."""
        _posixshmem.shm_unlink(name)

else:

    def create(name: str) -> int:
        """The descriptor of a new, empty file; FileExistsError, OSError."""
        try:
            return int(posix_ipc.SharedMemory(name, flags=posix_ipc.O_CREX, mode=0o600).fd)
        except posix_ipc.ExistentialError as error:
            raise FileExistsError(str(error)) from None
        except posix_ipc.Error as error:
            raise OSError(str(error)) from None

    def unlink(name: str) -> None:
        """Remove a file; FileNotFoundError, OSError."""
        try:
            posix_ipc.unlink_shared_memory(name)
        except posix_ipc.ExistentialError as error:
            raise FileNotFoundError(str(error)) from None
        except posix_ipc.Error as error:
            raise OSError(str(error)) from None
