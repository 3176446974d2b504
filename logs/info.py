"""What a log holds, at a glance: laid out as `mcap info` lays it out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from channels.units import to_s
from logs.reader import LogReader

_FROM_RUN = {"scenario": "scenario", "seed": "seed", "version": "heliograph"}
"""What is told of the run, and its keys in the run's metadata."""
_SHORT = 60


def info(path: Path) -> dict[str, Any]:
    """A summary of a log, ready for JSON. Times in seconds, sizes in bytes. Raises LogError as LogReader."""
    with LogReader(path) as log:
        duration_s = to_s(log.end_ns - log.start_ns)
        topics = [
            {
                "topic": name,
                "messages": topic.messages,
                "hz": round(topic.messages / duration_s, 3) if duration_s else None,
                "encoding": topic.encoding,
                "schema": topic.schema_name,
                "schema_encoding": topic.schema_encoding,
            }
            for name, topic in log.topics.items()
        ]
        return {
            "file": str(path),
            "size_bytes": log.size_bytes,
            "library": log.library,
            "profile": log.profile,
            **{name: log.run.get(key) for name, key in _FROM_RUN.items()},
            "complete": log.complete,
            "torn": log.torn,
            "lost_bytes": log.size_bytes - log.whole_bytes if log.torn else 0,
            "messages": sum(topic.messages for topic in log.topics.values()),
            "start_s": to_s(log.start_ns),
            "end_s": to_s(log.end_ns),
            "duration_s": duration_s,
            **_chunks(log),
            "topics": topics,
            "metadata": [{"name": name, "content": content} for name, content in log.metadata],
            "attachments": [
                {"name": file.name, "media_type": file.media_type, "size_bytes": len(file.data)}
                for file in log.attachments()
            ],
        }


def format_info(summary: dict[str, Any]) -> str:
    """The summary as text for people."""
    lines = [
        *_aligned(_facts(summary)),
        "channels:",
        *_channels(summary["topics"]),
        f"attachments: {len(summary['attachments'])}",
        *(
            f"  {file['name']}  {file['size_bytes']} B  {file['media_type']}"
            for file in summary["attachments"]
        ),
        f"metadata: {len(summary['metadata'])}",
    ]
    for record in summary["metadata"]:
        lines.append(f"  {record['name']}")
        lines += [f"    {key}: {_shortened(value)}" for key, value in record["content"].items()]
    return "\n".join(lines)


def _chunks(log: LogReader) -> dict[str, Any]:
    packed = sum(size for _, size, _ in log.chunks)
    unpacked = sum(size for _, _, size in log.chunks)
    return {
        "chunks": len(log.chunks),
        "compression": ", ".join(sorted({name or "none" for name, _, _ in log.chunks})),
        "chunk_bytes": packed,
        "message_bytes": unpacked,
        "compression_ratio": round(unpacked / packed, 2) if packed else None,
        "largest_chunk_bytes": max((size for _, _, size in log.chunks), default=0),
    }


def _facts(summary: dict[str, Any]) -> list[tuple[str, str]]:
    facts = [("file", f"{summary['file']} ({summary['size_bytes']} B)"), ("library", summary["library"])]
    facts += [("profile", summary["profile"] or "none")]
    facts += [(key, summary[key]) for key in _FROM_RUN if summary[key] is not None]
    facts += [("state", _state(summary)), ("messages", str(summary["messages"]))]
    facts += [("duration", f"{summary['duration_s']:.9g} s")]
    facts += [("start", f"{summary['start_s']:.9f} s"), ("end", f"{summary['end_s']:.9f} s")]
    if summary["chunks"]:
        sizes = (
            f"{summary['message_bytes']} B in {summary['chunk_bytes']} B, {summary['compression_ratio']} to 1"
        )
        facts += [("compression", f"{summary['compression']}: {sizes}")]
    return [*facts, ("chunks", f"{summary['chunks']} (up to {summary['largest_chunk_bytes']} B)")]


def _state(summary: dict[str, Any]) -> str:
    if summary["torn"]:
        return f"torn: {summary['lost_bytes']} B at the end are lost; `heliograph recover` makes it whole"
    return "complete" if summary["complete"] else "aborted: the run did not come to its end"


def _channels(topics: list[dict[str, Any]]) -> list[str]:
    rows = [
        (
            f"  ({number})",
            topic["topic"],
            f"{topic['messages']} msgs" + ("" if topic["hz"] is None else f" ({topic['hz']:.2f} Hz)"),
            f": {topic['schema']} [{topic['schema_encoding']}]",
        )
        for number, topic in enumerate(topics, start=1)
    ]
    widths = [max((len(row[column]) for row in rows), default=0) for column in range(4)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]


def _aligned(facts: list[tuple[str, str]]) -> list[str]:
    width = max(len(name) for name, _ in facts) + 2
    return [f"{name + ':':{width}}{value}" for name, value in facts]


def _shortened(text: str) -> str:
    line = text.replace("\n", "\\n")
    return line if len(line) <= _SHORT else f"{line[:_SHORT]}... ({len(text)} characters)"
