"""Users' controllers cannot decide how a command ends, nor does a run depend on those before it."""

import os
import sys
import textwrap

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from rrd import read

from twin.control import plants
from twin.control.closed_loop import run
from twin.control.laws.library import controller
from twin.control.laws.user import MOST_STATES
from twin.errors import InputError
from twin.report.run_files import read_track, write_run
from twin.report.run_rerun import of_run, write_rrd
from twin.rigs import preset

RIG = preset("bossi2009")
PERIOD = 2e-3
MEASURED = {"hub_angle": 0.1, "time": 0.5}


def write(folder, text, file="mine.py"):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / file).write_text(textwrap.dedent(text))
    return f"{folder / file}:make"


def loaded(folder, text):
    return controller(write(folder, text), RIG, PERIOD)


def short_run(law, duration=0.02):
    return run(plants.make_plant("modal"), law, lambda time: 0.1, duration)


def reporting(folder, states):
    """A controller whose states are an expression of n, the number of the sample."""
    return loaded(
        folder,
        f"""
        from itertools import count
        class Endless:
            def items(self):
                return ((name, 0) for name in count())
        class make:
            n = -1
            def torque(self, y, r):
                self.n += 1
                return 0.0
            @property
            def states(self):
                n = self.n
                return {states}
        """,
    )


LAW = "def make(measured, reference):\n    "


# What ends, raises or returns nonsense


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("import sys; sys.exit(0)", "it ends the program, with exit code 0"),
        ("import os; os._exit(0)", "it ends the program, with exit code 0"),
        ("exit()", "it ends the program, with exit code None"),
        ("raise KeyboardInterrupt", "KeyboardInterrupt"),
        ("raise GeneratorExit('x')", "GeneratorExit: x"),
        ("raise type('E', (Exception,), {'__str__': lambda self: 1 / 0})", "E$"),
        ("raise type('E', (BaseException,), {})('many\\nlines')", "E: many lines$"),
    ],
)
@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("pass\n{}", 2),
        ("def make(rig):\n    {}", 2),
        ("class make:\n    def torque(self, y, r):\n        {}", 3),
        ("class make:\n    @property\n    def torque(self):\n        {}", 4),
        ("class make:\n    def reset(self):\n        {}\n    def torque(self, y, r):\n        return 0", 3),
        (
            "class make:\n    def torque(self, y, r):\n        return 0\n"
            "    @property\n    def states(self):\n        {}",
            6,
        ),
    ],
)
def test_whatever_it_raises_wherever_is_one_message_with_the_line(tmp_path, text, line, statement, message):
    with pytest.raises(InputError, match=f"mine.py: line {line}: {message}"):
        short_run(loaded(tmp_path, text.format(statement)))


@pytest.mark.parametrize(
    "answer",
    ["10**400", "10**5000", "1e200", "-float('inf')", "1j", "None", "True", "'0.5'", "b'1'", "[0.1]", "{}"]
    + ["__import__('numpy').zeros(2)", "__import__('numpy').zeros(0)", "__import__('numpy').complex128(1)"]
    + ["(x for x in iter(int, 1))", "type('R', (), {'__repr__': lambda self: 1 / 0})()"],
)
def test_what_is_no_torque_is_said(tmp_path, answer):
    with pytest.raises(InputError, match=r"mine.py: at 0.5 s the controller returned .*; expected a torque"):
        loaded(tmp_path, LAW + f"return {answer}").torque(dict(MEASURED), 0.0)


@pytest.mark.parametrize(
    "answer",
    ["np.float32(0.25)", "np.array(0.25)", "np.array([[0.25]])", "Fraction(1, 4)", "Decimal('0.25')"],
)
def test_every_kind_of_number_is_a_torque(tmp_path, answer):
    imports = "import numpy as np\nfrom fractions import Fraction\nfrom decimal import Decimal\n"
    assert loaded(tmp_path, imports + LAW + f"return {answer}").torque(dict(MEASURED), 0.0) == 0.25


def test_its_arguments_are_its_own(tmp_path):
    greedy = LAW + "angle = measured['hub_angle']\n    measured.clear()\n    return 0.1 * (reference - angle)"
    modest = LAW + "return 0.1 * (reference - measured['hub_angle'])"
    runs = [short_run(loaded(tmp_path / name, text)) for name, text in (("a", greedy), ("b", modest))]
    assert_array_equal(runs[0].true["hub_angle"], runs[1].true["hub_angle"])
    with pytest.raises(InputError, match="at 0 s the controller returned None"):
        short_run(loaded(tmp_path / "c", LAW + "return measured.clear()"))


@pytest.mark.parametrize(
    ("made", "message"),
    [
        ("control.tf([float('nan')], [1, 1])", "'make' has a coefficient that is not finite"),
        ("control.ss([[float('inf')]], [[1]], [[1]], [[0]])", "'make' has a coefficient that is not finite"),
        (
            "control.tf([1], [1, -1000])",
            r"'make' has a pole at 2/T = 1000 1/s, where Tustin's rule is singular",
        ),
    ],
)
def test_a_system_without_a_sampled_form_is_refused(tmp_path, made, message):
    with pytest.raises(InputError, match=f"mine.py: {message}"):
        loaded(tmp_path, f"import control\nmake = {made}")


def test_a_system_that_grows_without_bound_is_said_with_its_file(tmp_path):
    law = loaded(tmp_path, "import control\nmake = control.ss([[1e60]], [[1]], [[1]], [[0]], 2e-3)")
    with pytest.raises(InputError, match=r"mine.py: at 0.00\d s "):
        short_run(law)


@pytest.mark.parametrize("kind", ["folder", "pipe", "device"])
def test_only_a_regular_file_is_executed(tmp_path, kind):
    path = tmp_path / "mine.py"
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero")
    with pytest.raises(InputError, match="mine.py is (a folder|no regular file); expected a Python file"):
        controller(f"{path}:make", RIG, PERIOD)


def test_errors_in_a_neighbour_are_said_with_both_places(tmp_path):
    write(tmp_path, "x = 1\ndef oops(:", "gains.py")
    with pytest.raises(InputError, match=r"mine.py: line 1: SyntaxError: .*\(gains.py, line 2\)"):
        loaded(tmp_path, "import gains")


def test_what_it_prints_is_not_among_the_results(twin, tmp_path):
    write(tmp_path, "import os\nprint('hello')\nos.chdir('/')\n" + LAW + "return 0.0")
    code, out, err = twin(
        "run", "lq-step-120", "--plant", "modal", "--controller", "mine.py:make", "--csv", "r.csv"
    )
    assert code == 0
    assert "hello" not in out
    assert "hello" in err
    assert (tmp_path / "r.csv").exists()


@pytest.mark.parametrize(
    "command", ["validate mine.py:make --rigs 1", "run lq-step-120 --controller mine.py:make"]
)
def test_a_controller_that_ends_the_program_has_not_passed(twin, tmp_path, command):
    write(tmp_path, LAW + "raise SystemExit(0)")
    assert twin(*command.split()) == (
        2,
        "",
        "Error: mine.py: line 2: it ends the program, with exit code 0\n",
    )


@pytest.mark.parametrize("command", ["run", "validate"])
def test_the_help_says_that_the_file_is_executed(twin, command):
    assert "runs with your rights" in " ".join(twin(command, "--help")[1].split())


# One run after another


@pytest.mark.parametrize(
    "text",
    [
        "class make:\n    n = 0\n    def torque(self, y, r):\n        self.n += 1\n        return self.n",
        "class C:\n    n = []\n    def torque(self, y, r):\n        self.n.append(1)\n        return len(self.n)\n"
        "make = C()",
        "n = 0\ndef make(measured, reference):\n    global n\n    n += 1\n    return n",
        "def make(rig):\n    n = []\n    def law(y, r):\n        n.append(1)\n        return len(n)\n    return law",
        "import gains\ndef make(measured, reference):\n    gains.n += 1\n    return gains.n",
    ],
)
def test_every_run_has_a_controller_of_its_own_without_a_reset(tmp_path, text):
    write(tmp_path, "n = 0", "gains.py")
    law = loaded(tmp_path, text)
    assert_array_equal(short_run(law).torque_command, short_run(law).torque_command)


def test_a_reset_that_is_there_is_called(tmp_path):
    text = "class make:\n    def reset(self):\n        self.n = 3\n    def torque(self, y, r):\n        return self.n"
    assert short_run(loaded(tmp_path, text)).torque_command[0] == 3


def test_an_object_is_no_name_of_a_controller():
    with pytest.raises(InputError, match=r"the controller is <.*; expected a name or FILE.py:NAME"):
        controller(object(), RIG, PERIOD)


# Modules beside the file


def test_each_file_has_the_neighbours_of_its_own_folder(tmp_path, monkeypatch):
    late = "def make(measured, reference):\n    import later\n    return gains.K + later.K"
    for name, gain in (("a", 1), ("b", 2), ("elsewhere", 3)):
        write(tmp_path / name, f"K = {gain}", "gains.py")
        write(tmp_path / name, f"K = {10 * gain}", "later.py")
    monkeypatch.syspath_prepend(tmp_path / "elsewhere")
    laws = [loaded(tmp_path / name, f"import gains\n{late}") for name in ("a", "b")]
    before = list(sys.path), list(sys.meta_path), set(sys.modules)
    assert [law.torque(dict(MEASURED), 0.0) for law in (*laws, *laws)] == [11, 22, 11, 22]
    assert (list(sys.path), list(sys.meta_path), set(sys.modules)) == before
    import gains

    assert gains.K == 3
    laws[0].reset()
    assert laws[0].torque(dict(MEASURED), 0.0) == 11
    assert sys.modules["gains"] is gains
    del sys.modules["gains"]


def test_packages_beside_the_file_are_found(tmp_path):
    write(tmp_path / "laws", "K = 4", "gains.py")
    write(tmp_path / "more", "", "__init__.py")
    write(tmp_path / "more", "from laws.gains import K", "again.py")
    law = loaded(tmp_path, LAW + "from more.again import K\n    return K")
    assert law.torque(dict(MEASURED), 0.0) == 4
    assert not {"laws", "laws.gains", "more", "more.again"} & set(sys.modules)


def test_a_file_named_as_a_library_does_not_replace_it(tmp_path):
    for name in ("control", "numpy", "random"):
        write(tmp_path, "make = 3", f"{name}.py")
    name = write(
        tmp_path,
        "import control, numpy, random\nmake = control.ss([], [], [], [[random.choice([2])]])",
        "control.py",
    )
    law = controller(name, RIG, PERIOD)
    law.reset()
    assert law.torque({"hub_angle": 0.0, "time": 0.0}, 1.0) == 2


def test_classes_of_the_file_can_look_up_their_module(tmp_path):
    text = """
    from __future__ import annotations
    from dataclasses import dataclass, field
    @dataclass
    class make:
        gain: float = 0.5
        def torque(self, y, r):
            return self.gain
    """
    assert loaded(tmp_path, text).torque(dict(MEASURED), 0.0) == 0.5


# States


def test_a_state_that_is_not_always_reported_is_nan_meanwhile(tmp_path):
    recorded = short_run(reporting(tmp_path, "{'first': 1} if n < 3 else {'late': 2, 'flag': True}")).states
    assert list(recorded) == ["first", "late", "flag"]
    assert_array_equal(np.isnan(recorded["first"]), np.arange(11) >= 3)
    assert_array_equal(np.isnan(recorded["late"]), np.arange(11) < 3)
    assert recorded["flag"][-1] == 1.0


@pytest.mark.parametrize(
    ("states", "message"),
    [
        ("{'a': n if n < 3 else 'text'}", "states is {'a': 'text'}; expected a dict from names to numbers"),
        ("{'a': '1'}", "states is {'a': '1'}; expected a dict"),
        ("{'a': 1j}", "states is {'a': 1j}; expected a dict"),
        ("{'a': [1, 2]}", "states is {'a': .1, 2.}; expected a dict"),
        ("{'a': 0 if n < 3 else float('inf')}", "at 0.006 s the state 'a' is inf; expected a number up to"),
        ("{'a': 10**400}", "at 0 s the state 'a' is inf"),
        ("{1: 1, '1': 2}", "two states are called '1'"),
        ("{'': 1}", "the name of a state is ''; expected printable"),
        ("{' a': 1}", "the name of a state is ' a'"),
        ("{'a\\nb': 1}", "the name of a state is 'a.nb'"),
        ("{'\\x1b[2J': 1}", "the name of a state is"),
        ("{'\\ud800': 1}", "the name of a state is"),
        (f"dict.fromkeys(range({MOST_STATES + 1}), 0)", "there are more than 1000 states"),
        ("Endless()", "there are more than 1000 states"),
        ("self.nothing", "line 14: AttributeError: .*nothing"),
    ],
)
def test_states_that_cannot_be_recorded_are_said(tmp_path, states, message):
    with pytest.raises(InputError, match=f"mine.py: {message}"):
        short_run(reporting(tmp_path, states))


NAMES = ["θ", "ω", "x", "a,b", "a;b", "a/b", "a.b", "a_b", "a'b", "a\\b", 'a"b', "a b"]
NAMES += ["time", "hub_angle", "mode", "state_x"]
"""Names of states that a table, a path or another column could be mistaken for."""


def test_states_of_every_name_come_back_from_the_file(tmp_path):
    law = reporting(tmp_path, "{name: place for place, name in enumerate(" + repr(NAMES) + ")}")
    write_run(short_run(law, 0.12), tmp_path / "run.csv")
    track = read_track(tmp_path / "run.csv")
    assert {name: values[0] for name, values in track.states.items()} == {
        name: k for k, name in enumerate(NAMES)
    }
    assert track.modes is not None
    assert track.time[-1] == pytest.approx(0.12)


def test_states_of_every_name_have_a_place_of_their_own_in_the_viewer(tmp_path):
    law = reporting(tmp_path, "{name: place for place, name in enumerate(" + repr(NAMES) + ")}")
    write_rrd([of_run(short_run(law), "modal")], 1.0, tmp_path / "run.rrd", "a run")
    places = {place for place in read(tmp_path / "run.rrd") if place.startswith("/run/controller/")}
    assert len(places) == len(NAMES)
    assert {"/run/controller/θ", "/run/controller/ω"} <= places
