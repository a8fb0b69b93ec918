"""Croissant metadata of a dataset, by which catalogues find it and libraries read it.

Source: MLCommons, "Croissant Format Specification 1.1".
"""

from __future__ import annotations

from typing import Any

from malus.renderers.datasets.dataset_record import DATASET, DatasetRecord

CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "arrayShape": "cr:arrayShape",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "containedIn": "cr:containedIn",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "description": {"@container": "@language"},
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileProperty": "cr:fileProperty",
    "fileObject": "cr:fileObject",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isArray": "cr:isArray",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "name": {"@container": "@language"},
    "parentField": "cr:parentField",
    "path": "cr:path",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
"""The context that the specification prescribes, key by key."""

MEDIA_TYPES = {"json": "application/json", "exr": "image/x-exr", "tiff": "image/tiff"}
"""Kinds of the files of a scene by their suffix."""

SPLIT_NAMES = {
    "train": "cr:TrainingSplit",
    "val": "cr:ValidationSplit",
    "test": "cr:TestSplit",
}


def croissant(
    record: DatasetRecord, sha256: str, images: dict[str, str], description: str, cite_as: str
) -> dict[str, Any]:
    """JSON-LD of a dataset.

    Parameters
    ----------
    record : DatasetRecord
    sha256 : str
        Hash of `dataset.json`.
    images : dict of file name to description
        Image files of every scene.
    description, cite_as : str
    """
    suite = record.suite or {}
    name = str(suite.get("name", "scenes"))
    result: dict[str, Any] = {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "name": name,
        "description": description,
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "citeAs": cite_as,
        "keywords": ["polarisation", "Stokes vectors", "synthetic images", "rendering"],
        "version": record.versions.get("malus", "0.0.0"),
    }
    if suite.get("licence"):
        result["license"] = suite["licence"]
    result["distribution"] = _distribution(sha256, images)
    result["recordSet"] = _record_sets(record)
    return result


def _distribution(sha256: str, images: dict[str, str]) -> list[dict[str, Any]]:
    """The list of scenes, and the files that every scene has."""
    return [
        {
            "@type": "cr:FileObject",
            "@id": DATASET,
            "name": DATASET,
            "description": "Suite, versions, conventions in words, and every scene.",
            "contentUrl": DATASET,
            "encodingFormat": "application/json",
            "sha256": sha256,
        },
        *(
            {
                "@type": "cr:FileSet",
                "@id": file,
                "name": file,
                "description": text,
                "encodingFormat": MEDIA_TYPES[file.rpartition(".")[2]],
                "includes": f"*/{file}",
            }
            for file, text in images.items()
        ),
    ]


def _record_sets(record: DatasetRecord) -> list[dict[str, Any]]:
    """The table of scenes, and that of the splits where there are any."""
    keys = {
        "scene": "Id of the scene and name of its folder.",
        "shape": "Shape, and surroundings where there are any.",
        "material": "Material, or refractive index.",
        "surface": "Roughness and colour.",
        "body": "How light that enters the surface comes back.",
        "light": "Light.",
    }
    splits = sorted({entry.split for entry in record.scenes if entry.split is not None})
    fields = [_field(key, text) for key, text in keys.items()]
    if not splits:
        return [_record_set("scenes", "One row a scene.", fields, "scenes/scene")]
    split = _field("split", "The split of the scene.")
    fields.append(split | {"references": {"field": {"@id": "splits/name"}}})
    names = {
        "@type": "cr:Field",
        "@id": "splits/name",
        "name": "name",
        "description": "Name of the split.",
        "dataType": "sc:Text",
    }
    urls = {
        "@type": "cr:Field",
        "@id": "splits/url",
        "name": "url",
        "description": "Its meaning.",
        "dataType": ["sc:URL", "wd:Q3985153"],
    }
    of_splits = _record_set("splits", "The splits.", [names, urls], "splits/name")
    of_splits["dataType"] = "cr:Split"
    of_splits["data"] = [{"splits/name": s, "splits/url": SPLIT_NAMES[s]} for s in splits]
    return [of_splits, _record_set("scenes", "One row a scene.", fields, "scenes/scene")]


def _record_set(name: str, text: str, fields: list[dict[str, Any]], key: str) -> dict[str, Any]:
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": text,
        "key": {"@id": key},
        "field": fields,
    }


def _field(key: str, text: str) -> dict[str, Any]:
    """A field of the table of scenes, read from `dataset.json`."""
    return {
        "@type": "cr:Field",
        "@id": f"scenes/{key}",
        "name": key,
        "description": text,
        "dataType": "sc:Text",
        "source": {
            "fileObject": {"@id": DATASET},
            "extract": {"jsonPath": f"$.scenes[*].{key}"},
        },
    }
