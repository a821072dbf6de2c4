"""Stage metadata in sublayers, which USD ignores: it reads only that of the root layer."""

from collections.abc import Iterator

from pxr import Usd

_OF_THE_STAGE = (
    "defaultPrim",
    "upAxis",
    "metersPerUnit",
    "timeCodesPerSecond",
    "framesPerSecond",
    "startTimeCode",
    "endTimeCode",
)


def ineffective_metadata(stage: Usd.Stage) -> Iterator[tuple[str, str]]:
    """Yields the name of each metadatum that only a sublayer sets, to another value than the stage's, and a remark."""
    below = stage.GetLayerStack(includeSessionLayers=False)[1:]
    for name in _OF_THE_STAGE:
        layer = next((each for each in below if each.pseudoRoot.HasInfo(name)), None)
        if layer is None or stage.HasAuthoredMetadata(name):
            continue
        value = layer.pseudoRoot.GetInfo(name)
        if value != stage.GetMetadata(name):
            yield name, f"that of the sublayer {layer.GetDisplayName()}, {value}, has no effect"
