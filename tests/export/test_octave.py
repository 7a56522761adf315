"""The exported MATLAB script is run by GNU Octave, with stand-ins for `ss`, `lsim` and the plot."""

import shutil
import subprocess
from pathlib import Path

import control
import numpy as np
import pytest

from twin.export import RigToExport, exporter_of
from twin.rigs import preset

STAND_INS = """1;
function s = ss(A, B, C, D, varargin)
  s = struct('A', A, 'B', B, 'C', C, 'D', D);
  for k = 1:2:numel(varargin)
    s.(varargin{k}) = varargin{k + 1};
  end
  assert([numel(s.StateName) numel(s.InputName) numel(s.OutputName)] == [rows(A) columns(B) rows(C)]);
  assert([numel(s.InputDelay) numel(s.OutputDelay) numel(s.OutputUnit)] == [columns(B) rows(C) rows(C)]);
end
function y = lsim(s, u, t)
  n = rows(s.A);
  E = expm([s.A s.B; zeros(1, n + 1)] * (t(2) - t(1)));
  x = zeros(n, 1);
  y = zeros(numel(t), rows(s.C));
  for k = 1:numel(t)
    y(k, :) = (s.C * x + s.D * u(k))';
    x = E(1:n, 1:n) * x + E(1:n, n + 1) * u(k);
  end
end
function plot(varargin), end
function xlabel(varargin), end
function ylabel(varargin), end
"""


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="needs GNU Octave")
def test_the_script_simulates_what_python_control_does(tmp_path):
    given = RigToExport(preset("bossi2009"), {"gravity-tilt": {"tilt": 0.02, "direction": 1.1}}, 0.5)
    script = tmp_path / "rig.m"
    script.write_text(exporter_of(script).export(given).content, encoding="ascii")
    (tmp_path / "run.m").write_text(STAND_INS + "source rig.m\nprintf('%.12g ', y(end, :));\n")
    options = ["--no-gui", "--quiet", "--norc", "run.m"]
    ran = subprocess.run(
        ["octave-cli", *options], cwd=Path(tmp_path), capture_output=True, text=True, check=True
    )
    found = [float(text) for text in ran.stdout.split()]
    time = np.arange(0, 1.001, 2e-3)
    step = control.forced_response(given.linear.to_control(), time, np.full((1, len(time)), 0.01))
    np.testing.assert_allclose(found, given.linear.readings + step.outputs[:, -1], rtol=1e-6, atol=1e-10)
