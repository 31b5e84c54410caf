"""Drops files onto a window as a file manager does, by XDND, but without a mouse.

    python drag_source.py X Y PATH…

X and Y are in pixels of the screen, from its upper left corner. Exits with 1 where the window does not take the files.
The protocol: https://www.freedesktop.org/wiki/Specifications/XDND/
"""

import sys
import time
from pathlib import Path

from Xlib import X, display
from Xlib.protocol import event

VERSION = 5
PATIENCE = 10.0  # s
MOVES = 5
"""positions told before the drop: a window that is entered has to look first what it is given"""


class DragSource:
    """A window of its own, from which paths are dragged to (x, y)."""

    def __init__(self, x, y, paths):
        self.display = display.Display()
        self.root = self.display.screen().root
        self.at = x, y
        self.text = "".join(path.resolve().as_uri() + "\r\n" for path in paths).encode()
        self.window = self.root.create_window(0, 0, 1, 1, 0, X.CopyFromParent)
        self.window.set_selection_owner(self.atom("XdndSelection"), X.CurrentTime)
        self.target = self.window_below()

    def atom(self, name):
        return self.display.intern_atom(name)

    def window_below(self):
        """The innermost window at that point which takes drops."""
        found, window = None, self.root
        while window is not None:
            if window.get_full_property(self.atom("XdndAware"), X.AnyPropertyType):
                found = window
            topmost_first = reversed(window.query_tree().children)
            window = next((child for child in topmost_first if self.is_at(child)), None)
        return found

    def is_at(self, window):
        if window.get_attributes().map_state != X.IsViewable:
            return False
        size, at = window.get_geometry(), window.translate_coords(self.root, *self.at)
        return 0 <= at.x < size.width and 0 <= at.y < size.height

    def tell(self, kind, *numbers):
        data = [self.window.id, *numbers, 0, 0, 0, 0][:5]
        self.target.send_event(
            event.ClientMessage(window=self.target, client_type=self.atom(kind), data=(32, data))
        )
        self.display.flush()

    def tell_position(self, shift):
        x, y = self.at
        where = (x + shift << 16) | y
        self.tell("XdndPosition", 0, where, X.CurrentTime, self.atom("XdndActionCopy"))

    def hand_over(self, request):
        kept = request.property or request.target
        request.requestor.change_property(kept, request.target, 8, self.text)
        request.requestor.send_event(
            event.SelectionNotify(
                time=request.time, requestor=request.requestor, selection=request.selection,
                target=request.target, property=kept,
            )
        )  # fmt: skip
        self.display.flush()

    def answers(self):
        """Events, until there have been none for a while."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            if self.display.pending_events():
                yield self.display.next_event()
            else:
                time.sleep(0.02)

    def drop(self):
        """Whether the window took the files."""
        if self.target is None:
            return False
        self.tell("XdndEnter", VERSION << 24, self.atom("text/uri-list"))
        self.tell_position(0)
        told = 1
        for answer in self.answers():
            kind = answer.client_type if answer.type == X.ClientMessage else None
            if kind == self.atom("XdndStatus") and told < MOVES:
                self.tell_position(told)
                told += 1
            elif kind == self.atom("XdndStatus"):
                accepted = answer.data[1][1] & 1
                if not accepted:
                    return False
                self.tell("XdndDrop", 0, X.CurrentTime)
            elif answer.type == X.SelectionRequest:
                self.hand_over(answer)
            elif kind == self.atom("XdndFinished"):
                return True
        return False


if __name__ == "__main__":
    x, y, *paths = sys.argv[1:]
    sys.exit(not DragSource(int(x), int(y), [Path(path) for path in paths]).drop())
