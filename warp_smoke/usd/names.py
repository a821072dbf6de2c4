"""The USD attribute that holds each field of a scene record, for both reading and authoring."""

from collections.abc import Mapping
from dataclasses import fields

from warp_smoke.record import Record

TRANSFORM = "xformOp:*"

STAGE = {
    "start": "startTimeCode",
    "end": "endTimeCode",
    "time_codes_per_second": "timeCodesPerSecond",
    "meters_per_unit": "metersPerUnit",
    "up_axis": "upAxis",
}
MESH = {"triangles": "faceVertexIndices", "uvs": "primvars:st"}
LIGHT = {
    "color": "inputs:color",
    "intensity": "inputs:intensity",
    "normalize": "inputs:normalize",
    "enabled": "visibility",
    "illuminates": "collection:lightLink:includes",
    "shadowed_by": "collection:shadowLink:includes",
    "shadow_enable": "inputs:shadow:enable",
    "transform": TRANSFORM,
    "direction": TRANSFORM,
    "radius": "inputs:radius",
    "angle": "inputs:angle",
    "cone_angle": "inputs:shaping:cone:angle",
    "cone_softness": "inputs:shaping:cone:softness",
    "focus": "inputs:shaping:focus",
}
MATERIAL = {
    "diffuse_color": "inputs:diffuseColor",
    "diffuse_texture": "inputs:diffuseColor",
    "fresnel_r0": "inputs:specularColor",
    "specular_texture": "inputs:specularColor",
    "metallic": "inputs:metallic",
    "metallic_texture": "inputs:metallic",
    "roughness": "inputs:roughness",
    "roughness_texture": "inputs:roughness",
    "emissive_color": "inputs:emissiveColor",
    "emissive_texture": "inputs:emissiveColor",
    "occlusion": "inputs:occlusion",
    "occlusion_texture": "inputs:occlusion",
    "opacity": "inputs:opacity",
    "opacity_texture": "inputs:opacity",
    "opacity_threshold": "inputs:opacityThreshold",
    "normal_texture": "inputs:normal",
    "height_texture": "inputs:displacement",
}
TEXTURE = {
    "file": "inputs:file",
    "wrap_s": "inputs:wrapS",
    "wrap_t": "inputs:wrapT",
    "color_space": "inputs:sourceColorSpace",
    "scale": "inputs:scale",
    "bias": "inputs:bias",
}
TRANSFORM_2D = {"uv_scale": "inputs:scale", "uv_rotation": "inputs:rotation", "uv_translation": "inputs:translation"}
PROCEDURAL = {
    "kind": "smoke:procedural",
    "size": "smoke:proceduralSize",
    "color1": "smoke:proceduralColor1",
    "color2": "smoke:proceduralColor2",
    "zoom": "smoke:proceduralZoom",
    "center": "smoke:proceduralCenter",
    "max_iterations": "smoke:proceduralMaxIterations",
    "repeats": "smoke:proceduralRepeats",
}
CAMERA = {
    "focal_length": "focalLength",
    "horizontal_aperture": "horizontalAperture",
    "vertical_aperture": "verticalAperture",
    "horizontal_offset": "horizontalApertureOffset",
    "vertical_offset": "verticalApertureOffset",
}


def smoke_attribute(field: str) -> str:
    """Returns the attribute of a field: `time_scale` → `smoke:timeScale`."""
    first, *rest = field.split("_")
    return "smoke:" + first + "".join(word.capitalize() for word in rest)


def smoke_fields(record: type[Record], attributes: Mapping[str, object]) -> dict[str, str]:
    """Maps the fields of a record type to their attributes, for those found in `attributes`."""
    names = {field.name: smoke_attribute(field.name) for field in fields(record)}
    return {field: attribute for field, attribute in names.items() if attribute in attributes}
