"""Which blocks of the documents are typed, in which rig, and which are not, with the reason.

A page with blocks of sh or python has one entry in SITTINGS, with one line for each such block, in
the page's order: ``Typed`` for what tests/system/test_documents.py types, ``Told`` for what it does
not. tests/project/test_documents.py compares the two.
"""

from tests.support.documents import Sitting, Told, Typed
from tests.support.orchestrator_register import DEMO, ORCHESTRATORS

HANDS = "deploy/rigs/bring-up.toml"
ELSEWHERE = {"README.md": "tests/system/test_readme.py"}
"""Pages of which another test types every block, and says so if one escapes."""
BENCH = "it asks instruments of a bench"
ANOTHER_HOST = "it is for another host"
DOCKER = "it needs Docker; tests/project/test_containers.py holds the file to the rig's"

SITTINGS: dict[str, Sitting] = {
    **ORCHESTRATORS,
    "docs/tutorials/first-grip.md": Sitting(
        (
            Typed(".venv/bin/pincette job grip --force-mN 10", r"outcome +gripped"),
            Typed(".venv/bin/pincette job grip --force-mN 100", r"above the limit 40 mN", status=5),
        ),
        up=DEMO,
    ),
    "docs/tutorials/your-own-rig.md": Sitting(
        (
            Typed("cat > my-rig.toml"),
            Typed("export PINCETTE_RIG=my-rig.toml", r"limit 30 mN"),
            Typed("pincette up", r"is up at http://127.0.0.1:8000", stays=True),
            Typed("pincette model show", r"part\.stiffness_mN_per_um .* assumed"),
            Typed("pincette rig part remove"),
            Typed("pincette job calibrate noise --dry-run", r"feasible"),
            Typed("pincette job calibrate noise", r"accepted, model 1", seconds=200.0),
            Typed("pincette job calibrate free_response", r"accepted, model 2", seconds=500.0),
            Typed("pincette rig part place", r"accepted, model 3", seconds=300.0),
            Typed("pincette model show", r"part\.stiffness_mN_per_um +\S+ mN/µm +20"),
            Typed("pincette job grip --dry-run", r"feasible"),
            Typed("pincette job grip", r"outcome +gripped", seconds=200.0),
            Typed("pincette job grip --force-mN 35", r"above the limit 30 mN", status=5),
        ),
        slow=True,
    ),
    "docs/tutorials/write-a-driver.md": Sitting(
        (
            Typed("python docs/examples/driver/stand_in.py", r"an LDS at socket", stays=True),
            Typed("import socket", r"b'LDS,0017\\r'\nb'\+00012\.58\\r'"),
            Typed("from pincette.instruments.link", r"12\.58 µm"),
            Typed("pip install", r"example_lds, from pincette-example-lds 1\.0\.0"),
            Typed("cat > lds-rig.toml"),
            Typed("pincette doctor --rig", r"position sensor at socket://127.0.0.1:7471", status=1),
            Typed("sed 's/head = 1", r"option head = 9", status=1),
        ),
    ),
    "docs/tutorials/two-arms.md": Sitting(
        (
            Typed("make demo", r"outcome +gripped", seconds=120.0),
            Typed(".venv/bin/pincette up --rig", r"is up at http://127.0.0.1:8000", stays=True),
            Typed(".venv/bin/pincette job pair_track --place", r"outcome +tracked", seconds=90.0),
            Typed(".venv/bin/pincette job centre", r"outcome +gripped", seconds=90.0),
            Typed(".venv/bin/pincette job pair_grip", r"outcome +gripped", seconds=90.0),
            Typed(".venv/bin/pincette job pair_grip --dry-run", r"arm 2: position", status=5),
            Told(".venv/bin/pincette job carry", "test_pair.py carries a held part, lets it go"),
            Told(".venv/bin/pincette rig part", "test_two_arms_taught.py types it in lockstep"),
        ),
        slow=True,
    ),
    "docs/how-to/plan.md": Sitting(
        (
            Typed("curl -s 'http://127.0.0.1:8000/api/v1/jobs", r'"feasible":true'),
            Typed("curl -s http://127.0.0.1:8000/api/v1/traj", r'"kind":"track"'),
            Told(
                ".venv/bin/pincette job grip --force-mN 15 --force", "unit test_goal.py judges one"
            ),
        ),
        up=DEMO,
    ),
    "docs/how-to/claim.md": Sitting(
        (
            Told("eval", "tests/unit/cli/test_at_work.py claims from a shell"),
            Told("import secrets", "tests/unit/supervisor/test_claims.py sends the same requests"),
        )
    ),
    "docs/how-to/find-a-job.md": Sitting(
        (Told("pincette job list --text B7", "tests/system/test_page_search.py finds such a job"),)
    ),
    "docs/how-to/quick-grip.md": Sitting(
        (Typed("pincette job grip --profile gentle", r"outcome +gripped"),), up=DEMO
    ),
    "docs/how-to/recipes.md": Sitting(
        (Typed("curl -s http://127.0.0.1:8000/api/v1/recipes", r'"recipe":\{?.*bead-1mm'),), up=DEMO
    ),
    "docs/how-to/records.md": Sitting(
        (
            Told("API=http", "README.md's blocks fetch the same; it needs a job that has ended"),
            Told("import pyarrow", "tests/system/test_readme.py reads the same file"),
            Told("from mcap.reader", "tests/contract/test_record_in_other_tools.py reads it so"),
            Told("from datetime import", "tests/unit/records/test_record_times.py reads the times"),
            Told(
                "pincette job export --out jobs.csv --spreadsheet",
                "it needs a job that has ended: the tests of the command line write such files",
            ),
            Told(
                "pincette job describe last --pin yes",
                "it needs a job that has ended: test_jobs_found_again.py pins one",
            ),
            Told(
                "pincette job grip --sample B7",
                "it needs a rig: test_jobs_found_again.py says the same over REST",
            ),
            Told("pincette job list --batch", "test_jobs_found_again.py exports the same"),
            Told("pincette backup", "tests/unit/cli/test_backup.py does it"),
        )
    ),
    "docs/how-to/alarms.md": Sitting(
        (
            Typed("pincette checks", r"actuator\.latch"),
            Told(
                "pincette alarms list", "alarm 1 must be there: tests/system/test_page.py has one"
            ),
            Told(
                "pincette watch", "it is silent while nothing happens; test_at_work.py follows it"
            ),
            Told("(umask 077; echo", "tests/unit/supervisor/test_notify.py reads such a secret"),
            Told("import base64", "tests/unit/supervisor/test_notify.py verifies so"),
        ),
        up=DEMO,
    ),
    "docs/how-to/scripted-faults.md": Sitting(
        (
            Typed("export PINCETTE_RIG=deploy/rigs/bring-up.toml", r"output heal: done"),
            Typed("curl --json", r'"what":"stuck"'),
        ),
        up=HANDS,
    ),
    "docs/how-to/secure.md": Sitting(
        (
            Told("make demo SECURE=1", "tests/system/test_security.py runs the demo over TLS"),
            Typed("pincette security init"),
            Typed("pincette security issue"),
            Told("python docs/examples/secure", "tests/system/test_security.py runs the script"),
            Typed("pincette security add"),
            Typed("pincette security show", r"anna"),
            Typed("pincette security revoke", r"revoked: demo/estimator"),
        )
    ),
    "docs/how-to/rest-keys.md": Sitting(
        (
            Typed("pincette key add cell-7", r"cell-7"),
            Told("pincette user add", "tests/unit/supervisor/test_users.py adds and changes one"),
            Told('Supervisor("http://gripper.lab', ANOTHER_HOST),
            Told("export PINCETTE_URL=https", "tests/system/test_rest_tls.py asks over TLS"),
            Told('Supervisor("https://', "tests/system/test_rest_tls.py asks over TLS"),
            Told("docker compose exec", DOCKER),
            Told("pincette audit", "tests/system/test_rest_access.py asks for it with such a key"),
            Told("pincette audit verify", "tests/unit/supervisor/test_audit.py verifies a log"),
        )
    ),
    "docs/how-to/compose.md": Sitting(
        (
            Told("pincette run loop", "tests/system/test_composed.py runs both, each in its rig"),
            Told("pincette security add", "tests/system/test_composed.py adds it to its folder"),
        )
    ),
    "docs/how-to/several-rigs.md": Sitting(
        (
            Typed("pincette up --rig deploy/rigs/left.toml", r"is up at", stays=True),
            Typed("pincette up --rig deploy/rigs/right.toml", r"is up", stays=True),
            Typed("pincette rigs", r"right"),
        ),
        slow=True,
    ),
    "docs/how-to/batches.md": Sitting(
        (
            Typed("from concurrent.futures", r"4000\.0 4 \(", seconds=300.0),
            Told("pip install 'pincette[cluster]'", "requirements/dev.txt has the extra already"),
            Told("from distributed import Client", "tests/orchestrators/test_extras.py does it"),
        ),
        slow=True,
    ),
    "docs/how-to/device-servers.md": Sitting(
        (Told("socat -t0 TCP-LISTEN", "tests/contract/test_device_servers.py starts socat"),)
    ),
    "docs/how-to/calibrate.md": Sitting(
        (
            Told("pincette doctor", "docs/tutorials/your-own-rig.md types it"),
            Told("pincette job calibrate noise", "docs/tutorials/your-own-rig.md types it"),
            Told(
                "pincette job calibrate compliance", "weights are hung, and the return key is asked"
            ),
            Told("pincette job continue", "it answers a job that waits for a weight"),
            Told("pincette model proposals", "docs/tutorials/your-own-rig.md types it"),
            Told("pincette model use", "tests/system/test_page_calibrations.py goes back so"),
            Told(
                "curl", "tests/system/test_page_calibrations.py and test_api.py ask the same paths"
            ),
        )
    ),
    "docs/how-to/add-a-driver.md": Sitting(
        (
            Told('"""A displacement', "tests/project/test_example_driver.py installs and opens it"),
            Told(".venv/bin/pip install", "docs/tutorials/write-a-driver.md types it"),
        )
    ),
    "docs/how-to/add-a-law.md": Sitting(
        (
            Told(
                '"""Impedance control with integral action',
                "tests/unit/supervisor/test_example_law.py installs it and grips by it",
            ),
        )
    ),
    "docs/how-to/add-a-job-kind.md": Sitting(
        (
            Told('"""``tap``: touch', "tests/system/test_example_job_kind.py installs and runs it"),
            Told('"""Plan, result', "tests/system/test_example_job_kind.py installs and runs it"),
            Told("pip install", "tests/system/test_example_job_kind.py installs and runs it"),
        )
    ),
    "docs/how-to/listen.md": Sitting(
        (Told("pip install", "requirements/dev.txt has both; test_examples.py runs the scripts"),)
    ),
    "docs/how-to/bring-up.md": Sitting(
        (
            Told("pincette run router", "tests/system/test_bring_up.py starts both so"),
            Told("pincette init bench.toml", "tests/system/test_bring_up.py types it"),
            Told("pincette doctor", BENCH),
            Told("pincette doctor --move", BENCH),
            Told("pincette up", BENCH),
            Told("pincette doctor", BENCH),
            Told("pincette bring-up", "tests/system/test_bring_up.py types it"),
            Told("kill -9 PID", BENCH),
            Told("pincette job grip", BENCH),
        )
    ),
    "docs/how-to/real-time.md": Sitting(
        (
            Told("pincette latency", "it measures for minutes; tests/bench/realtime runs it"),
            Told("make demo ARGS=", "tests/integration/test_kilohertz.py plays the grip"),
            Told("docker compose", DOCKER),
            Told("pincette doctor", "tests/unit/diagnostics/test_machine.py asks what it says"),
            Told("chrt", "it changes priorities, which root may alone"),
            Told("pincette timing", "tests/unit/cli/test_timing.py shows it"),
        )
    ),
    "docs/how-to/containers.md": Sitting(
        (
            Told("docker compose up -d --build --wait", "tests/engine/test_brief.py types both"),
            Told("docker compose --profile sila", "tests/engine/test_adapters.py types it"),
            Told("docker buildx imagetools", "it asks the registry of the base image"),
            Told("docker compose up -d --build --wait", DOCKER),
            Told("export COMPOSE_FILE=docker-compose.yml:deploy/real-rig.yml", BENCH),
            Told("docker compose -f docker-compose.yml -f deploy/listen.yml", DOCKER),
            Told("export COMPOSE_FILE=docker-compose.yml:deploy/listen.yml", DOCKER),
            Told("docker compose run --rm certificates", DOCKER),
            Told("docker compose -f docker-compose.yml -f deploy/offline.yml", DOCKER),
            Told("git pull", "it needs Docker, and another version than this one"),
            Told("docker inspect", DOCKER),
        )
    ),
    "docs/how-to/observe.md": Sitting(
        (
            Typed("curl -s --fail-with-body http://127.0.0.1:8000/metrics", r"pincette_"),
            Typed("pincette key add prometheus", r"prometheus"),
            Told("journalctl", "it reads the journal of systemd's units"),
        ),
        up=DEMO,
    ),
    "docs/how-to/several-hosts.md": Sitting(
        (
            Told("pincette up --rig", "tests/system/test_several_hosts.py starts both sides so"),
            Told("pincette up --server", "tests/system/test_several_hosts.py starts both sides so"),
            Typed("pincette security init pki"),
            Told("pip install", "tests/unit/supervisor/test_postgresql.py has such a server"),
        )
    ),
    "docs/how-to/systemd.md": Sitting(
        (
            Told("useradd", "it is for root; tests/project/test_systemd.py reads the units"),
            Told("systemctl status", "it asks systemd about the units"),
        )
    ),
    **{
        f"services/{name}/README.md": Sitting(
            (Told(f"pincette run {name}", "`pincette up` starts it, in every sitting with a rig"),)
        )
        for name in ("recorder", "rig")
    },
    **{
        f"services/{name}/README.md": Sitting(
            (Told(f"pincette run {name}", f"docs/how-to/{name}.md types it"),)
        )
        for name in ("foxglove", "sila")
    },
}
