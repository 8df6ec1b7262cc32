"""The log in npm's @mcap/core, the library inside Foxglove and Lichtblick."""

import json
import subprocess
from pathlib import Path

from picktree.logs import RunLog

from ..needs import needs, packages

HERE = Path(__file__).parent / "node"


@needs(packages("logs"))
def test_every_message_is_read_and_decoded(log_path: Path) -> None:
    done = subprocess.run(["node", "read.mjs", str(log_path)], cwd=HERE, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    with RunLog(log_path) as log:
        assert found["topics"] == {
            name: {"schema": info.schema, "encoding": info.encoding, "count": info.messages}
            for name, info in log.topics.items()
        }
        assert found["attachments"] == list(log.attachments)
        assert sorted(found["metadata"]) == sorted(log.metadata)
