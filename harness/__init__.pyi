from harness.api import IncompleteRunWarning as IncompleteRunWarning
from harness.api import RunResults as RunResults
from harness.api import compare_runs as compare_runs
from harness.api import load_run as load_run
from harness.api import read_rig as read_rig
from harness.api import run_experiment as run_experiment
