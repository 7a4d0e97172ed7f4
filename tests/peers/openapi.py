"""Every path of the daemon answers as its OpenAPI document says, whatever it is asked: judged by Schemathesis.

    python tests/peers/openapi.py OUTRIGGER

Schemathesis makes requests that the document allows and such that it forbids, with and without the token, against a daemon
with a mock sensor and a mock rig. No answer may be a server error, and every one has the status, the type and the schema
that the document names. The two WebSockets are asked in plain HTTP here; tests/peers/foxglove_live.py and tests/browser
speak with them. Requests come no faster than the daemon lets one address make them. Exit status 1 when something differs.
"""

import contextlib
import json
import pathlib
import subprocess
import sys
import tempfile

TOKEN = "token-for-schemathesis-0123456789"
STREAMS = "/api/v1/(stream|foxglove)"
# what the document promises of answers; the rest is about requests
ANSWERS = "not_a_server_error,status_code_conformance,content_type_conformance,response_schema_conformance"


@contextlib.contextmanager
def running(command):
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        text = ""
        for line in child.stdout:
            text += line
            with contextlib.suppress(json.JSONDecodeError):
                yield json.loads(text)
                break
        else:
            raise AssertionError(f"{command} ended before it was ready: {text}")
    finally:
        child.terminate()
        child.wait(30)


def schemathesis(url, folder, checks, *more):
    program = pathlib.Path(sys.executable).absolute().parent / "schemathesis"
    command = [
        program, "run", f"{url}api/v1/openapi.json", "--header", f"Authorization: Bearer {TOKEN}", "--checks", checks,
        "--phases", "coverage,fuzzing", "--max-examples", "12", "--generation-deterministic", "--rate-limit", "15/s",
        "--workers", "1", "--continue-on-failure", "--no-color", *more]
    return subprocess.run(command, cwd=folder, timeout=400).returncode  # it leaves notes where it runs


def main(program):
    program = pathlib.Path(program).absolute()
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        folder = pathlib.Path(folder)
        (folder / "token").write_text(TOKEN)
        rig = stack.enter_context(running([program, "--json", "mock", "rig"]))["port"]
        (folder / "rig.toml").write_text(f'''format = "outrigger-rig/1"
[[sensor]]
name = "front"
model = "vlp-16"
listen = "127.0.0.1:0"
[rig]
port = "{rig}"
[predict]
room = "-10,-6,-1.5,10,6,2.5"
''')
        ready = stack.enter_context(running([
            program, "--json", "daemon", "--config", folder / "rig.toml", "--listen", "127.0.0.1:0", "--out", folder / "sessions",
            "--token-file", folder / "token", "--warn-below-mib", "1", "--stop-below-mib", "1"]))
        to = ready["sensors"][0]["address"]
        stack.enter_context(running([program, "--json", "mock", "sensor", "--model", "vlp-16", "--to", to]))
        url = ready["url"]
        codes = [schemathesis(url, folder, "all", "--exclude-path-regex", STREAMS),
                 schemathesis(url, folder, ANSWERS, "--include-path-regex", STREAMS)]
    return 1 if any(codes) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
