"""Finding the stage that a path names: a file, or the one in a folder of results."""

from pathlib import Path

RESULTS_SUFFIX = ".results.usdc"


def find_stage(path: str | Path) -> Path:
    """Returns the stage that a path names: the file itself, or the root layer in a folder of results.

    Raises:
        ValueError: there is no such file, or the folder holds no results or those of several runs.
    """
    path = Path(path)
    if path.is_file():
        return path
    names = [results.name.removesuffix(RESULTS_SUFFIX) for results in path.glob(f"*{RESULTS_SUFFIX}")]
    if len(names) != 1:
        found = ", ".join(sorted(names)) or "none"
        raise ValueError(f"{path}: no such file, nor a folder with the results of one run; found: {found}")
    return path / f"{names[0]}.usda"
