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
        (Typed("export PINCETTE_RIG=deploy/rigs/bring-up.toml", r"output heal: done"),), up=HANDS
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
