"""Drives the window of OSTRA in a virtual display by mouse and keys, as a user does.

Widgets are found by the names and roles that a screen reader gets (AT-SPI), so that a script does not depend on where
they are. Every action is counted. The seconds that a practised user needs for it are those of the keystroke-level model
(Card, Moran and Newell, 1980): 0.28 s for a key, 1.1 s to point, 0.1 s to press or release a button, 1.35 s to decide.

Needs Xvfb, openbox, xdotool, ImageMagick, D-Bus, at-spi2-core and pyatspi (Debian: python3-pyatspi).
"""

import os
import re
import shutil
import subprocess
import tempfile
import time

import gi

gi.require_version("Atspi", "2.0")
import pyatspi  # noqa: E402

KEY, POINT, BUTTON, DECIDE = 0.28, 1.1, 0.1, 1.35
# Free pixels between the image and the border of its pane, both sides together.
MARGIN = 20


class Display:
    """A virtual display with a window manager and a bus for accessibility."""

    def __init__(self, width, height):
        self.processes = []
        read, write = os.pipe()
        self.start("Xvfb", "-displayfd", str(write), "-screen", "0", f"{width}x{height}x24", "-nolisten", "tcp",
                   pass_fds=[write])
        os.close(write)
        os.environ["DISPLAY"] = ":" + os.read(read, 16).decode().strip()
        address = subprocess.run(["dbus-daemon", "--session", "--fork", "--print-address=1", "--print-pid=1"],
                                 capture_output=True, text=True, check=True).stdout.split()
        os.environ["DBUS_SESSION_BUS_ADDRESS"], self.bus = address[0], int(address[1])
        subprocess.run(["gdbus", "call", "--session", "--dest", "org.a11y.Bus", "--object-path", "/org/a11y/bus",
                        "--method", "org.freedesktop.DBus.Properties.Set", "org.a11y.Status", "IsEnabled", "<true>"],
                       check=True, stdout=subprocess.DEVNULL)
        # Without borders, so that places in the window are places on the display.
        self.config = tempfile.NamedTemporaryFile("w", suffix=".xml")
        self.config.write('<openbox_config xmlns="http://openbox.org/3.4/rc"><applications><application class="*">'
                          "<decor>no</decor></application></applications></openbox_config>")
        self.config.flush()
        self.start("openbox", "--config-file", self.config.name)

    def start(self, *command, **options):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, **options)
        self.processes.append(process)
        return process

    def close(self):
        for process in reversed(self.processes):
            process.terminate()
            process.wait()
        os.kill(self.bus, 15)


def is_named(node, name):
    """Whether the name of a node is `name`, or matches it where `name` is a compiled pattern."""
    return bool(name.search(node.name)) if isinstance(name, re.Pattern) else node.name == name


class Window:
    """A running window, with a home folder of its own."""

    def __init__(self, program, shots, size=(1280, 800), arguments=(), environment=None):
        """`environment` has more variables for the program."""
        self.program, self.shots, self.size = program, shots, size
        self.number, self.actions, self.seconds = 0, 0, 0.0
        self.home = tempfile.mkdtemp(prefix="ostra-window-")
        os.makedirs(shots, exist_ok=True)
        variables = dict(os.environ, HOME=self.home, XDG_CONFIG_HOME=self.home + "/config",
                         XDG_DATA_HOME=self.home + "/data", XDG_CACHE_HOME=self.home + "/cache")
        variables.pop("ORT_DYLIB_PATH", None)
        variables.setdefault("XDG_RUNTIME_DIR", self.home)
        variables.update(environment or {})
        self.process = subprocess.Popen([program, *arguments], env=variables, cwd=self.home)
        self.began = time.monotonic()
        self.waited = 0.0
        self.id = self.xdotool("search", "--sync", "--onlyvisible", "--pid", str(self.process.pid)).split()[-1]
        self.xdotool("windowsize", "--sync", self.id, *map(str, size))
        self.xdotool("windowmove", self.id, "0", "0")
        self.xdotool("windowfocus", "--sync", self.id)
        self.wait(lambda: self.root() is not None, 30, "the window has no accessible tree")

    @staticmethod
    def xdotool(*words):
        return subprocess.run(["xdotool", *words], check=True, capture_output=True, text=True).stdout

    def root(self):
        for application in pyatspi.Registry.getDesktop(0):
            if application and application.get_process_id() == self.process.pid and application.childCount:
                return application
        return None

    def nodes(self):
        """All nodes that have a name, in the order of the tree."""
        def walk(node):
            if node is None:
                return
            yield node
            for index in range(node.childCount):
                try:
                    yield from walk(node.getChildAtIndex(index))
                except Exception:  # It went away between the calls.
                    continue
        root = self.root()
        return walk(root) if root else iter(())

    def find(self, name, role=None, seconds=20, last=False):
        """The first (or last) node whose name is `name`, or matches it where `name` is a compiled pattern."""
        return self.wait(lambda: self.look(name, role, last), seconds, f"no widget is named {name!r}")

    def look(self, name, role=None, last=False):
        found = None
        for node in self.nodes():
            try:
                if is_named(node, name) and (role is None or node.getRoleName() == role):
                    found = node
                    if not last:
                        break
            except Exception:  # It went away between the calls.
                continue
        return found

    def wait(self, ready, seconds, complaint):
        end = time.monotonic() + seconds
        while True:
            result = ready()
            if result:
                return result
            if time.monotonic() >= end:
                self.shot("failed")
                raise TimeoutError(f"{complaint}; visible: {self.names()}")
            if self.process.poll() is not None:
                raise RuntimeError(f"the window ended with {self.process.returncode}")
            time.sleep(0.1)

    def wait_for(self, name, seconds):
        """Waits for a computation; the time counts as waiting, not as the user's."""
        began = time.monotonic()
        found = self.find(name, seconds=seconds)
        self.waited += time.monotonic() - began
        return found

    def wait_for_focus(self, name):
        """Waits until a field has the keyboard, as a user does who looks before typing."""
        def focused():
            for node in self.nodes():
                try:
                    if is_named(node, name) and node.getState().contains(pyatspi.STATE_FOCUSED):
                        return True
                except Exception:
                    continue
            return False
        self.wait(focused, 20, f"{name!r} does not get the keyboard")

    def wait_until_idle(self, seconds=600):
        """Waits until no job runs any more."""
        began = time.monotonic()
        time.sleep(0.5)
        self.wait(lambda: not self.look("Stop"), seconds, "a job does not end")
        self.waited += time.monotonic() - began

    def names(self):
        found = []
        for node in self.nodes():
            try:
                found.append((node.name, node.getRoleName()))
            except Exception:
                continue
        return [f"{name} ({role})" for name, role in found if name]

    @staticmethod
    def rect(node):
        extents = node.queryComponent().getExtents(pyatspi.WINDOW_COORDS)
        return extents.x, extents.y, extents.width, extents.height

    def count(self, seconds):
        self.actions += 1
        self.seconds += seconds

    def press_at(self, x, y, button=1, keys=()):
        for key in keys:
            self.xdotool("keydown", key)
        self.xdotool("mousemove", "--window", self.id, str(round(x)), str(round(y)))
        time.sleep(0.15)
        self.xdotool("mousedown", str(button))
        time.sleep(0.08)
        self.xdotool("mouseup", str(button))
        for key in keys:
            self.xdotool("keyup", key)
        self.count(DECIDE + POINT + 2 * BUTTON + KEY * len(keys))
        time.sleep(0.3)

    def drag(self, begin, end):
        self.xdotool("mousemove", "--window", self.id, *(str(round(at)) for at in begin))
        time.sleep(0.15)
        self.xdotool("mousedown", "1")
        for step in range(1, 9):
            at = [a + (b - a) * step / 8 for a, b in zip(begin, end)]
            self.xdotool("mousemove", "--window", self.id, *(str(round(one)) for one in at))
            time.sleep(0.05)
        self.xdotool("mouseup", "1")
        self.count(DECIDE + 2 * POINT + 2 * BUTTON)
        time.sleep(0.3)

    def click(self, name, role=None, last=False):
        """Clicks the middle of a widget, once it stays where it is."""
        def resting():
            before = self.rect(self.find(name, role, last=last))
            time.sleep(0.4)
            return before if self.rect(self.find(name, role, last=last)) == before else None
        x, y, width, height = self.wait(resting, 20, f"{name!r} does not stay where it is")
        self.press_at(x + width / 2, y + height / 2)

    def on_image(self, x, y, size):
        """The place in the window of pixel `(x, y)` of an image of `size` that fits its pane."""
        left, top, width, height = self.rect(self.find(re.compile("^Image ."), "image"))
        scale = min((width - MARGIN) / size[0], (height - MARGIN) / size[1])
        return left + width / 2 + (x - size[0] / 2) * scale, top + height / 2 + (y - size[1] / 2) * scale

    def click_image(self, x, y, size, button=1, keys=(), wait=True):
        """Clicks a pixel of the shown image and waits for the answer, unless another job runs."""
        self.press_at(*self.on_image(x, y, size), button, keys)
        if wait:
            self.wait_until_idle()

    def box_image(self, begin, end, size):
        self.drag(self.on_image(*begin, size), self.on_image(*end, size))
        self.wait_until_idle()

    def key(self, *chords):
        for chord in chords:
            self.xdotool("key", chord)
            self.count(DECIDE + KEY * len(chord.split("+")))
            time.sleep(0.25)

    def type(self, text):
        self.xdotool("type", "--delay", "20", text)
        self.count(DECIDE + KEY * len(text))
        time.sleep(0.25)

    def shot(self, name):
        self.number += 1
        time.sleep(0.4)
        path = os.path.join(self.shots, f"{self.number:02}-{name}.png")
        subprocess.run(["import", "-window", "root", path], check=True)
        return path

    def report(self, name):
        total = time.monotonic() - self.began
        return (f"{name}: {self.actions} actions, {self.seconds:.0f} s of a practised user, "
                f"{self.waited:.0f} s waited, {total:.0f} s in all")

    def run(self, *words):
        """Runs a command line of the program where the window was started."""
        return subprocess.run([self.program, *words], check=True, capture_output=True, text=True, cwd=self.home).stdout

    def close(self):
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        shutil.rmtree(self.home, ignore_errors=True)
