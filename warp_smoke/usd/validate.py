"""Validation of a stage for all DCCs: the problems that public validators and our own checks find, in one list."""

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
# Outputs of a material for all renderers; those for one renderer are prefixed with its name.
_FOR_ALL = ("surface", "displacement", "volume")
# Slow or untidy things that every DCC reads all the same: the rules that fail them, and a part of their message.
_STYLE = (
    ("UsdAsciiPerformanceChecker", ""),
    ("NormalsExistChecker", ""),
    ("TypeChecker", "Missing type"),
    ("DefaultPrimChecker", 'of type ""'),
    ("ExtentsChecker", "does not have any extent"),
)
# Problems that several validators report, each in its own words: of a prim, or else of the stage or a file.
_OF_A_PRIM = {"extent": re.compile(r"\bextent\b"), "type": re.compile(r'Missing type|of type ""')}
_OF_ALL = re.compile(r"metersPerUnit|upAxis|(?<=dependency ').*(?=')|(?<=there is no file ).*")
# The layer that a rule finds slow, which only its message names.
_SLOW = re.compile(r"(?<=attribute\(s\) in ').*(?=' have)")


def validate_stage(path: str | Path) -> list[Problem]:
    """Finds the problems of a stage, either a user's or one with results.

    This runs all validators of usd-core, the rules of usd-validation-nvidia if that is installed, our own checks
    (`checks`), and the scene reader for what it refuses. Problems that the public validators have with shaders for one
    renderer, whose nodes they do not know, become infos; untidy things that every DCC reads become warnings.

    Args:
        path: the stage, or a folder that holds results.

    Returns:
        Each problem once: those of the stage before those of the layers with results, errors first in both.

    Raises:
        ValueError: there is no such file or folder.
    """
    register_schema()
    path = find_stage(path)
    quiet = UsdUtils.CoalescingDiagnosticDelegate()  # the list contains what USD would print
    try:
        stage = Usd.Stage.Open(str(path))
        foreign = _for_one_renderer(stage)
        asked = [_eased(problem, foreign) for problem in (*_ask_usd(stage), *_ask_nvidia(path))]
        found = [replace(each, part=_part(each, stage, path)) for each in _once([*check_stage(stage), *asked])]
        problems = [*found, *_ask_reader(stage, path)]
    except Tf.ErrorException as error:  # also raised while values of a damaged file are read
        return [Problem("error", str(path), usd_message(error.args[0]), "usd")]
    except UnicodeDecodeError:
        return [Problem("error", str(path), "its names are not UTF-8", "usd")]
    del quiet
    return sorted(dict.fromkeys(problems), key=lambda each: (each.part != "stage", _ORDER.index(each.severity)))


def _once(problems: Iterable[Problem]) -> Iterator[Problem]:
    """Yields each problem once, as reported by the first validator that finds it."""
    told = {}
    for problem in problems:
        if told.setdefault(_subject(problem), problem.source) == problem.source:
            yield problem


def _subject(problem: Problem) -> tuple[str, str]:
    """Returns where a problem is and what it is about, the same for all validators that find it."""
    for about, said in _OF_A_PRIM.items():
        if said.search(problem.message):
            return problem.where.partition(".")[0], about
    if found := _OF_ALL.search(problem.message):
        return "", Path(found.group()).name
    return problem.where, problem.message


def _part(problem: Problem, stage: Usd.Stage, path: Path) -> str:
    """Returns whose a problem is, from the layer with the prim's definition or the property's value, or the file."""
    if not path.with_name(f"{path.stem}{RESULTS_SUFFIX}").exists():
        return "stage"
    where = problem.where.partition(" /")[0]  # the first of several places
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
    """Returns paths and source files of the shaders that only feed outputs for one renderer."""
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
    """Returns a problem as it is, as an info if it concerns one renderer's nodes, or as a warning if it is style."""
    parts = {place.partition(".")[0] for place in problem.where.split()}
    if parts & foreign or any(name.endswith(".mdl") and name in problem.message for name in foreign):
        return replace(problem, severity="info")
    if any(problem.source == rule and said in problem.message for rule, said in _STYLE):
        return replace(problem, severity="warning")
    return problem


def _upstream(output: UsdShade.Output) -> Iterator[Usd.Prim]:
    """Yields the prims of all shaders that an output depends on."""
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
