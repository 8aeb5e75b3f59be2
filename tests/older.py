"""Tasks in which fields that are left out ask for nothing, and neither rod nor joints weigh anything."""

from collections.abc import Mapping
from typing import Any

from topo_search.model import Task
from topo_search.model.flying import with_older_defaults


def older_task(data: Mapping[str, Any] | None = None, **fields: Any) -> Task:
    """The task of these fields; those left out mean what they do in older files, but tolerances are required."""
    fields = {**(data or {}), **fields}
    if isinstance(tolerances := fields.get("tolerances"), Mapping) and any(tolerances.values()):
        fields["flight"] = {"tolerances": True, **fields.get("flight", {})}
    return Task.model_validate(with_older_defaults(fields))
