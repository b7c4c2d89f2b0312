"""The card of a dataset: what it holds, from what, under which licences, and how it was made."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from typing import Any

from waveformer.datagen.dataset_reader import Dataset

CARD_FILE, README_FILE = "card.json", "README.md"
_MOST_CATEGORIES = 20


def card_of(data: Dataset) -> dict[str, Any]:
    """The card as JSON values, a function of what is committed."""
    records = [data.record(index) for index in data.indices]
    objects = {record["object_id"]: record for record in records if "object_id" in record}
    quarantined = data.quarantined
    return {
        "kind": data.layout.kind,
        "samples": {
            "requested": data.layout.num_samples,
            "committed": len(data),
            "quarantined": len(quarantined),
            "pending": data.num_pending,
        },
        "objects": len(objects),
        "splits": _counts(record.get("split", "") for record in objects.values()),
        "categories": _counts(record.get("category") or "unknown" for record in objects.values()),
        "licences": _counts(record.get("licence") or "unknown" for record in objects.values()),
        "quarantine": {str(index): reason for index, reason in quarantined.items()},
        "arrays": {
            info.name: {
                "shape": list(info.shape),
                "dtype": info.dtype,
                "unit": info.unit,
                "bytes_per_sample": info.sample_bytes,
            }
            for info in data.layout.arrays
        },
        "shard_samples": data.layout.shard_samples,
        "settings": dict(data.layout.settings),
        "provenance": dict(data.provenance),
    }


def card_markdown(name: str, card: Mapping[str, Any]) -> str:
    """The card for people, to be the README of the dataset's folder."""
    samples = card["samples"]
    lines = [
        f"# {name}",
        "",
        (
            f"{samples['requested']} samples requested = {samples['committed']} committed + {samples['quarantined']} "
            f"quarantined + {samples['pending']} pending, of {card['objects']} objects. "
            f"Made by waveformer {card['provenance'].get('waveformer', '?')}."
        ),
        "",
        "| array | shape of a sample | type | unit | bytes |",
        "|---|---|---|---|---|",
        *(
            f"| {array} | {' x '.join(map(str, info['shape']))} | {info['dtype']} | {info['unit'] or ''} | "
            f"{info['bytes_per_sample']:,} |"
            for array, info in card["arrays"].items()
        ),
        "",
        *_listed("Splits", card["splits"]),
        *_listed("Categories", card["categories"]),
        *_listed("Licences of the meshes", card["licences"]),
        "A sample inherits the licence of its object; it stands in the sample's record.",
        "",
    ]
    if card["quarantine"]:
        lines += ["## Quarantined", ""]
        lines += [f"- {index}: {reason}" for index, reason in card["quarantine"].items()]
        lines.append("")
    lines += [
        "## Read it",
        "",
        "```python",
        "from waveformer.datagen.dataset_reader import open_dataset",
        "",
        f'data = open_dataset("{name}")',
        "sample = data.read(data.indices[0])  # arrays by name",
        "```",
        "",
        "Any Zarr v3 reader opens `samples.zarr`; samples that were not made are NaN there, integers -1.",
        "",
        "## Settings",
        "",
        "```json",
        json.dumps(card["settings"], indent=1),
        "```",
        "",
    ]
    return "\n".join(lines)


def _listed(title: str, counts: Mapping[str, int]) -> list[str]:
    shown = list(counts.items())[:_MOST_CATEGORIES]
    rest = len(counts) - len(shown)
    text = ", ".join(f"{key or 'unknown'} {count}" for key, count in shown)
    return [f"{title}: {text}{f', and {rest} more' if rest else ''}.", ""] if shown else []


def _counts(values: Any) -> dict[str, int]:
    """Most frequent first, equal ones by name."""
    return dict(sorted(Counter(values).items(), key=lambda item: (-item[1], item[0])))
