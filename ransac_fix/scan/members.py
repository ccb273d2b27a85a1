"""What the attributes of the classes of a file are, and in C++ its globals."""

from ransac_fix.scan.form import Expr
from ransac_fix.scan.nodes import MAX_CHOICES, Nodes


class Members:
    """The values that members are set to anywhere in a file, one of which each of them is.

    Parameters
    ----------
    nodes : Nodes
    """

    def __init__(self, nodes: Nodes) -> None:
        self._nodes = nodes
        self._values: dict[tuple[str, str], list[Expr]] = {}
        self._closed = False

    def add(self, owner: str, name: str, value: Expr) -> None:
        """Take a value for a member of a class, or of ``global``."""
        if self._closed:
            return
        known = self._values.setdefault((owner, name), [])
        if len(known) < MAX_CHOICES and not any(value is one for one in known):
            known.append(value)

    def close(self) -> None:
        """Take no more values: all of them have been seen."""
        self._closed = True

    def get(self, owner: str, name: str) -> Expr | None:
        """Give what a member may be; None where nothing sets it."""
        known = self._values.get((owner, name))
        return self._nodes.choice(known) if known else None

    def inherited(self, name: str) -> Expr | None:
        """Give a member that one class of the file sets, which may be the base of another."""
        found = [one for (owner, own), one in self._values.items() if own == name and owner]
        return self._nodes.choice(found[0]) if len(found) == 1 else None
