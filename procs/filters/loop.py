"""One process for several filters of users: calls the update of each once a period, in the order of the system file."""

from __future__ import annotations

from functools import partial

from trocar.procs.document.system import WALL, SystemConfig
from trocar.procs.filters.hosted import HostedFilter, filter_in
from trocar.procs.tables.manifest import hung_s
from trocar.procs.user.life import live
from trocar.procs.user.process import UserNode


class FiltersLoop(UserNode):
    """The process; it has nothing of its own but its filters."""

    filters: tuple[HostedFilter, ...] = ()

    def setup(self) -> None:
        """See UserNode; none of them keeps the others from beginning."""
        document = self.own.document
        most_s = 0.5 * hung_s(self.own.row, simulated=document.clock != WALL)
        self.filters = tuple(
            HostedFilter(self.system, document.process(row.name), partial(filter_in, row.module), most_s)
            for row in document.users if row.host == self.name)

    def update(self) -> None:
        """See UserNode."""
        for each in self.filters:
            each.cycle()

    def quit(self) -> None:
        """See UserNode."""
        for each in self.filters:
            each.stop()


def find(document: SystemConfig, name: str) -> type[UserNode]:
    """What every such process is."""
    return FiltersLoop


def main() -> None:
    """Run it to its end."""
    live("filters", find)


if __name__ == "__main__":
    main()
