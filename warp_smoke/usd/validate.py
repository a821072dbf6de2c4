"""Is this a stage that every DCC accepts: what the public validators and our own checks say, in one list."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from pxr import Sdf, Tf, Usd, UsdShade, UsdUtils, UsdValidation

from warp_smoke.usd.checks import Problem, check_stage
from warp_smoke.usd.find import RESULTS_SUFFIX, find_stage
from warp_smoke.usd.read import read_stage, usd_message
from warp_smoke.usd.schema import register_schema

_ORDER = ("error", "warning", "info")
# Outputs of a material for any renderer; those for one have its name before.
_FOR_ALL = ("surface", "displacement", "volume")
# What is slow or untidy, but which every DCC reads: rules that call it a failure, and a part of what they say.
_STYLE = (
    ("UsdAsciiPerformanceChecker", ""),
    ("NormalsExistChecker", ""),
    ("TypeChecker", "Missing type"),
    ("DefaultPrimChecker", 'of type ""'),
    ("ExtentsChecker", "does not have any extent"),
)
# What several validators tell, each in words of its own: of a prim, or else of the stage or of a file.
_OF_A_PRIM = {"extent": re.compile(r"\bextent\b"), "type": re.compile(r'Missing type|of type ""')}
_OF_ALL = re.compile(r"metersPerUnit|upAxis|(?<=dependency ').*(?=')|(?<=there is no file ).*")
# The layer that a rule finds slow, which it only tells in its message.
_SLOW = re.compile(r"(?<=attribute\(s\) in ').*(?=' have)")


def validate_stage(path: str | Path) -> list[Problem]:
    """Looks for what is wrong with a stage, a user's or one with results.

    Asked are all validators of usd-core, the rules of usd-validation-nvidia where that is installed, our own checks
    (`checks`), and the scene reader for what it refuses. What the public validators say of shaders for one renderer,
    whose nodes they do not know, becomes an info, and what every DCC reads but is untidy a warning.

    Args:
        path: the stage, or a folder that holds results.

    Returns:
        Each problem once, those of the stage before those of the layers with results, errors first.

    Raises:
        ValueError: there is no such file or folder.
    """
    register_schema()
    path = find_stage(path)
    quiet = UsdUtils.CoalescingDiagnosticDelegate()  # what USD would print stands in the list
    try:
        stage = Usd.Stage.Open(str(path))
        foreign = _for_one_renderer(stage)
        asked = [_eased(problem, foreign) for problem in (*_ask_usd(stage), *_ask_nvidia(path))]
        found = [replace(each, part=_part(each, stage, path)) for each in _once([*check_stage(stage), *asked])]
        problems = [*found, *_ask_reader(stage, path)]
    except Tf.ErrorException as error:  # also while values are read, from a file that is damaged
        return [Problem("error", str(path), usd_message(error.args[0]), "usd")]
    except UnicodeDecodeError:
        return [Problem("error", str(path), "its names are not UTF-8", "usd")]
    del quiet
    return sorted(dict.fromkeys(problems), key=lambda each: (each.part != "stage", _ORDER.index(each.severity)))


def _once(problems: Iterable[Problem]) -> Iterator[Problem]:
    """What several validators find, as the first of them tells it."""
    told = {}
    for problem in problems:
        if told.setdefault(_subject(problem), problem.source) == problem.source:
            yield problem


def _subject(problem: Problem) -> tuple[str, str]:
    """Where a problem is and what it is about, the same for all validators that find it."""
    for about, said in _OF_A_PRIM.items():
        if said.search(problem.message):
            return problem.where.partition(".")[0], about
    if found := _OF_ALL.search(problem.message):
        return "", Path(found.group()).name
    return problem.where, problem.message


def _part(problem: Problem, stage: Usd.Stage, path: Path) -> str:
    """Whose a problem is: that of the layer which has the prim's definition, the property's value, or the file."""
    if not path.with_name(f"{path.stem}{RESULTS_SUFFIX}").exists():
        return "stage"
    where = problem.where.partition(" /")[0]  # of several places the first
    found = stage.GetObjectAtPath(where) if Sdf.Path.IsValidPathString(where) else None
    file = str(path) if where == "/" else where
    if found and where != "/":
        values = found.GetPropertyStack() if isinstance(found, Usd.Property) else []
        file = [*found.GetPrim().GetPrimStack()[-1:], *values[:1]][-1].layer.realPath
    return "results" if Path(file).resolve().is_relative_to(path.parent.resolve()) else "stage"


def _ask_usd(stage: Usd.Stage) -> Iterator[Problem]:
    kinds = UsdValidation.ValidationErrorType
    severities = {kinds.Error: "error", kinds.Warn: "warning", kinds.Info: "info"}
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    for error in UsdValidation.ValidationContext(validators).Validate(stage):
        sites = " ".join(map(_site, error.GetSites())) or stage.GetRootLayer().identifier
        yield Problem(severities[error.GetType()], sites, error.GetMessage(), error.GetValidator().GetMetadata().name)


def _for_one_renderer(stage: Usd.Stage) -> set[str]:
    """Paths, and source files, of shaders that lead only to outputs of their material for one renderer."""
    names = set()
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdShade.Material):
            outputs = UsdShade.Material(prim).GetOutputs()
            for_all = {shader for output in outputs if output.GetBaseName() in _FOR_ALL for shader in _upstream(output)}
            for shader in {shader for output in outputs for shader in _upstream(output)} - for_all:
                attributes = shader.GetAuthoredPropertiesInNamespace("info")
                sources = [each.Get() for each in attributes if each.GetName().endswith(":sourceAsset")]
                names |= {str(shader.GetPath()), *(source.path for source in sources)}
    return names


def _eased(problem: Problem, foreign: set[str]) -> Problem:
    """A problem as it is, an info where it is with what only one renderer knows, or a warning where it is style."""
    parts = {place.partition(".")[0] for place in problem.where.split()}
    if parts & foreign or any(name.endswith(".mdl") and name in problem.message for name in foreign):
        return replace(problem, severity="info")
    if any(problem.source == rule and said in problem.message for rule, said in _STYLE):
        return replace(problem, severity="warning")
    return problem


def _upstream(output: UsdShade.Output) -> Iterator[Usd.Prim]:
    """The prims of the shaders that an output is made of."""
    found: dict[Usd.Prim, None] = {}
    waiting = [output]
    while waiting:
        for source in waiting.pop().GetConnectedSources()[0]:
            prim = source.source.GetPrim()
            if prim not in found:
                found[prim] = None
                waiting += source.source.GetInputs()
    yield from found


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
        message = " ".join(issue.message.split())
        slow = _SLOW.search(message)
        where = slow.group() if slow else str(getattr(issue.at, "path", path))
        rule = issue.rule.__name__ if issue.rule else "usd-validation-nvidia"
        yield Problem(severities.get(issue.severity, "error"), where, message, rule)


def _ask_reader(stage: Usd.Stage, path: Path) -> Iterator[Problem]:
    try:
        read_stage(stage, str(path))
    except ValueError as error:
        yield Problem("error", str(path), str(error).removeprefix(f"{path}: "))
