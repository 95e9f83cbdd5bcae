"""A user's process: runs the class or function in the module that the system file names, or several filters."""

from __future__ import annotations

from functools import partial

from trocar.procs.document.system import WALL
from trocar.procs.node.node import Node
from trocar.procs.node.runtime import run
from trocar.procs.tables.manifest import FILTERS, hung_s
from trocar.procs.user.filters import HostedFilter, filter_in
from trocar.procs.user.process import UserLoop, class_in


class FiltersLoop(UserLoop):
    """The process that calls the filters, and does nothing else."""

    filters: tuple[HostedFilter, ...] = ()

    def setup(self) -> None:
        """See UserLoop; a filter that fails does not prevent the start of others."""
        document = self.node.document
        most_s = 0.5 * hung_s(self.node.row, simulated=document.clock != WALL)
        self.filters = tuple(
            HostedFilter(self.system, document.process(row.name), partial(filter_in, row.module), most_s)
            for row in document.users if row.host == self.name)

    def update(self) -> None:
        """See UserLoop."""
        for each in self.filters:
            each.cycle()

    def quit(self) -> None:
        """See UserLoop."""
        for each in self.filters:
            each.stop()


def made(node: Node) -> UserLoop:
    """The process of this instance, by the system file."""
    declared = node.document.user(node.name)
    if node.kind == FILTERS:
        return FiltersLoop(node)
    return UserLoop(node) if declared is None else class_in(declared.module)(node)


def main() -> None:
    """Run a user's process."""
    run("user", made, traces=True)  # which line of the user's it was


if __name__ == "__main__":
    main()
