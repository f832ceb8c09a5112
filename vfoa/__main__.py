"""``python -m vfoa``: the command that the package installs."""

from importlib.metadata import entry_points

if __name__ == "__main__":
    (command,) = entry_points(group="console_scripts", name="vfoa")
    command.load()()
