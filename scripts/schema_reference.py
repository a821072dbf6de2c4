"""Writes docs/schema.md from the USD schema's own documentation."""

from pathlib import Path

from pxr import Sdf

ROOT = Path(__file__).parents[1]
SCHEMA = ROOT / "warp_smoke/usd/schema/generatedSchema.usda"


def schema_reference() -> str:
    """Returns the reference as Markdown: one section for each schema, one row for each attribute."""
    layer = Sdf.Layer.FindOrOpen(str(SCHEMA))
    lines = [
        "# Schema reference",
        "",
        "Written by `python scripts/schema_reference.py` from the schema's own documentation. The schemas are",
        "codeless: a DCC shows them once `warp_smoke/usd/schema` is on `PXR_PLUGINPATH_NAME`, and keeps them without.",
    ]
    for prim in layer.rootPrims:
        if not prim.attributes:
            continue
        lines += [
            "",
            f"## {prim.name}",
            "",
            prim.documentation,
            "",
            "| attribute | type | default | |",
            "|---|---|---|---|",
        ]
        for attribute in prim.attributes:
            default = "" if attribute.default is None else f"`{attribute.default}`"
            allowed = attribute.GetInfo("allowedTokens")
            text = attribute.documentation + (f" One of: {', '.join(map(str, allowed))}." if allowed else "")
            lines.append(f"| `{attribute.name}` | {attribute.typeName} | {default} | {text} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    (ROOT / "docs/schema.md").write_text(schema_reference(), encoding="utf-8")
