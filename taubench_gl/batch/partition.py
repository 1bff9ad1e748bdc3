"""Pairs of one job as a Parquet file: the rows of frames.csv, and the exact counts and histograms behind them.

``lobes`` is null, or JSON of lobe -> [reason words, pixel counts] of pairs whose lobes are counted apart.
Counts are sparse: ``word`` / ``word_pixels`` are the reason words that occur and their pixel counts,
``bin`` / ``bin_pixels`` are the histogram bins: feature * bins + bin, in the order of ``features.FEATURES``.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taubench_gl.checksums import values_sha256
from taubench_gl.conventions import HISTOGRAM_BINS
from taubench_gl.data_files import parse_json
from taubench_gl.errors import OutputError
from taubench_gl.features import FEATURES, MASK_WORDS
from taubench_gl.metrics.counts import Counts
from taubench_gl.outputs import plain_text
from taubench_gl.run_schema import CAMERA_COLUMNS, COUNT_COLUMNS, EXACT_COLUMNS

REPORT_KEY, SHA256_KEY = b"taubench-gl", b"sha256"
"""Keys of the file's metadata: the worker's report on the job and on itself, as JSON; checksum of report and rows."""


@dataclass(frozen=True, slots=True)
class PairRecord:
    """One pair: its ``position`` among the job's pairs, its row of frames.csv, its exact counts.

    ``lobes``: lobe -> mask histogram with direct and indirect of that lobe, where lobes are counted apart.
    """

    position: int
    row: dict[str, Any]
    counts: Counts
    lobes: Mapping[str, np.ndarray] = field(default_factory=dict)


def require_pyarrow() -> Any:
    """pyarrow with its Parquet module.  Raises OutputError if it is not installed."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        hint = "pip install 'taubench-gl[batch]'"
        raise OutputError("a batch stores Parquet files, which requires pyarrow", hint=hint) from None
    return pyarrow


def encode(records: Sequence[PairRecord], report: Mapping[str, Any]) -> bytes:
    """The bytes of a Parquet file."""
    pa = require_pyarrow()
    columns: dict[str, list[Any]] = {name: [] for name in _fields(pa)}
    for record in records:
        columns["pair"].append(record.position)
        for name in (*_PLAIN, *COUNT_COLUMNS, *EXACT_COLUMNS, *CAMERA_COLUMNS):
            columns[name].append(record.row.get(name) if name in EXACT_COLUMNS else record.row[name])
        for name, values in (("word", record.counts.mask_histogram), ("bin", record.counts.histograms)):
            flat = np.asarray(values, dtype=np.int64).ravel()
            used = np.flatnonzero(flat)
            columns[name].append(used)
            columns[f"{name}_pixels"].append(flat[used])
        columns["lobes"].append(_lobes_text(record.lobes))
    fields = _fields(pa)
    arrays = [pa.array(columns[name], type=kind) for name, kind in fields.items()]
    table = pa.Table.from_arrays(arrays, schema=pa.schema(list(fields.items())))
    text = json.dumps(report)
    digest = values_sha256([json.loads(text), table.to_pylist()])
    sink = io.BytesIO()
    pa.parquet.write_table(
        table.replace_schema_metadata({REPORT_KEY: text, SHA256_KEY: digest}), sink, compression="zstd"
    )
    return sink.getvalue()


def decode(data: bytes) -> tuple[list[PairRecord], dict[str, Any]]:
    """The inverse of ``encode``.  Raises ValueError for other data, such as truncated files and changed numbers."""
    pa = require_pyarrow()
    try:
        table = pa.parquet.read_table(io.BytesIO(data))
        report = parse_json(table.schema.metadata[REPORT_KEY])
        rows = table.to_pylist()
        if values_sha256([report, rows]).encode() != table.schema.metadata.get(SHA256_KEY):
            raise ValueError("not the pairs that were written")
    except (pa.ArrowException, OSError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(f"not a partition of pairs: {error}") from None
    if set(table.column_names) != set(_fields(pa)):
        raise ValueError("not a partition of pairs: other columns")
    out = []
    for values in rows:
        mask_histogram = np.zeros(MASK_WORDS, dtype=np.int64)
        mask_histogram[values.pop("word")] = values.pop("word_pixels")
        histograms = np.zeros(len(FEATURES) * HISTOGRAM_BINS, dtype=np.int64)
        histograms[values.pop("bin")] = values.pop("bin_pixels")
        position, lobes = values.pop("pair"), _lobes_of(values.pop("lobes"))
        counts = Counts(mask_histogram, histograms.reshape(len(FEATURES), HISTOGRAM_BINS))
        out.append(PairRecord(position, values, counts, lobes))
    return out, report


def frames_table(jobs: Iterable[tuple[str, str, Mapping[str, Any], Sequence[Mapping[str, Any]]]]) -> bytes:
    """A Parquet file of all pairs of all jobs: ``job``, ``scene``, swept settings (as text), and frames.csv."""
    pa = require_pyarrow()
    jobs = list(jobs)
    swept = list(dict.fromkeys(key for _, _, sweep, _ in jobs for key in sweep))
    fields = {"job": pa.string(), "scene": pa.string()} | {f"sweep_{key}": pa.string() for key in swept}
    exact = EXACT_COLUMNS if any(row.get(EXACT_COLUMNS[0]) is not None for *_, rows in jobs for row in rows) else ()
    wanted = (*_PLAIN, *COUNT_COLUMNS, *exact, *CAMERA_COLUMNS)
    fields |= {name: kind for name, kind in _fields(pa).items() if name in wanted}
    fields["camera_cut"] = pa.bool_()
    columns: dict[str, list[Any]] = {name: [] for name in fields}
    for job, scene, sweep, rows in jobs:
        for row in rows:
            values = (
                {"job": job, "scene": _text(scene)} | {f"sweep_{k}": _text(sweep.get(k)) for k in swept} | dict(row)
            )
            for name in fields:
                value = values.get(name) if name in EXACT_COLUMNS else values[name]
                columns[name].append(bool(value) if name in ("camera_cut", "gimbal") else value)
    arrays = [pa.array(columns[name], type=kind) for name, kind in fields.items()]
    sink = io.BytesIO()
    pa.parquet.write_table(
        pa.Table.from_arrays(arrays, schema=pa.schema(list(fields.items()))), sink, compression="zstd"
    )
    return sink.getvalue()


_PLAIN = ("frame", "time_s", "gimbal")


def _text(value: Any) -> str | None:
    if value is None:
        return None
    return plain_text(value) if isinstance(value, str) else json.dumps(value)


def _lobes_text(lobes: Mapping[str, np.ndarray]) -> str | None:
    used = {lobe: np.flatnonzero(histogram) for lobe, histogram in lobes.items()}
    return json.dumps({lobe: [w.tolist(), lobes[lobe][w].tolist()] for lobe, w in used.items()}) if lobes else None


def _lobes_of(text: str | None) -> dict[str, np.ndarray]:
    """The inverse of ``_lobes_text``.  Raises ValueError."""
    out = {}
    for lobe, (words, pixels) in ({} if text is None else parse_json(text)).items():
        out[lobe] = np.zeros(MASK_WORDS, dtype=np.int64)
        out[lobe][words] = pixels
    return out


def _fields(pa: Any) -> dict[str, Any]:
    """Column -> Arrow type.  A count that is not measured is null."""
    return {
        "pair": pa.int64(),
        "frame": pa.int64(),
        "time_s": pa.float64(),
        **dict.fromkeys((*COUNT_COLUMNS, *EXACT_COLUMNS), pa.int64()),  # exact ones are null where not asked for
        **dict.fromkeys(CAMERA_COLUMNS, pa.float64()),
        "gimbal": pa.bool_(),
        "word": pa.list_(pa.int32()),
        "word_pixels": pa.list_(pa.int64()),
        "bin": pa.list_(pa.int32()),
        "bin_pixels": pa.list_(pa.int64()),
        "lobes": pa.string(),
    }
