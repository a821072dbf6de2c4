"""Is this a stage that every DCC accepts: what the public validators and our own checks say, in one list."""

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from pxr import Tf, Usd, UsdUtils, UsdValidation

from warp_smoke.usd.checks import Problem, check_stage
from warp_smoke.usd.find import find_stage
from warp_smoke.usd.read import read_stage, usd_message
from warp_smoke.usd.schema import register_schema

_ORDER = ("error", "warning", "info")


def validate_stage(path: str | Path) -> list[Problem]:
    """Looks for what is wrong with a stage, a user's or one with results.

    Asked are all validators of usd-core, the rules of usd-validation-nvidia where that is installed, our own checks
    (`checks`), and the scene reader for what it refuses.

    Args:
        path: the stage, or a folder that holds results.

    Returns:
        Each problem once, errors first.

    Raises:
        ValueError: there is no such file or folder.
    """
    register_schema()
    path = find_stage(path)
    quiet = UsdUtils.CoalescingDiagnosticDelegate()  # what USD would print stands in the list
    try:
        stage = Usd.Stage.Open(str(path))
        problems = [*_ask_usd(stage), *_ask_nvidia(path), *check_stage(stage), *_ask_reader(stage, path)]
    except Tf.ErrorException as error:  # also while values are read, from a file that is damaged
        return [Problem("error", str(path), usd_message(error.args[0]), "usd")]
    except UnicodeDecodeError:
        return [Problem("error", str(path), "its names are not UTF-8", "usd")]
    del quiet
    return sorted(dict.fromkeys(problems), key=lambda problem: _ORDER.index(problem.severity))


def _ask_usd(stage: Usd.Stage) -> Iterator[Problem]:
    kinds = UsdValidation.ValidationErrorType
    severities = {kinds.Error: "error", kinds.Warn: "warning", kinds.Info: "info"}
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    for error in UsdValidation.ValidationContext(validators).Validate(stage):
        sites = " ".join(map(_site, error.GetSites())) or stage.GetRootLayer().identifier
        yield Problem(severities[error.GetType()], sites, error.GetMessage(), error.GetValidator().GetMetadata().name)


def _site(site: UsdValidation.ValidationErrorSite) -> str:
    if site.IsPrim():
        return str(site.GetPrim().GetPath())
    if site.IsProperty():
        return str(site.GetProperty().GetPath())
    return site.GetLayer().identifier if site.GetLayer() else "/"


def _ask_nvidia(path: Path) -> Iterator[Problem]:
    if find_spec("usd_validation_nvidia") is None:
        return
    from usd_validation_nvidia import IssueSeverity, ValidationEngine

    severities = {IssueSeverity.WARNING: "warning", IssueSeverity.INFO: "info"}
    for issue in ValidationEngine().validate(str(path)).issues():
        where = str(getattr(issue.at, "path", path))
        rule = issue.rule.__name__ if issue.rule else "usd-validation-nvidia"
        yield Problem(severities.get(issue.severity, "error"), where, " ".join(issue.message.split()), rule)


def _ask_reader(stage: Usd.Stage, path: Path) -> Iterator[Problem]:
    try:
        read_stage(stage, str(path))
    except ValueError as error:
        yield Problem("error", str(path), str(error).removeprefix(f"{path}: "))
