"""The blocks of the documents that tests/system/test_documents.py types, and the rig they need.

Each block is named by the beginning of its first line, in the order of its page. Blocks that are
not named are not typed. tests/system/test_readme.py types every block of README.md.
"""

from tests.support.documents import Sitting, Typed

DEMO = "deploy/rigs/demo.toml"
HANDS = "deploy/rigs/bring-up.toml"

SITTINGS: dict[str, Sitting] = {
    "docs/how-to/web-of-things.md": Sitting(
        (Typed("curl -s --fail-with-body http://127.0.0.1:8000/.well-known/wot"),),
        up=DEMO,
    ),
    "docs/tutorials/orchestrator.md": Sitting(
        (
            Typed("python docs/examples/orchestrator.py", "part-3: released", seconds=200.0),
            Typed("from pincette.client import Supervisor", r"True \[\]"),
            Typed("job = rig.start("),
            Typed("for event in job.events()", r"the part is held\nsucceeded"),
            Typed("for file in job.artifacts()", r"samples\.parquet \d+ [0-9a-f]{64}"),
        ),
        up=DEMO,
        slow=True,
    ),
    "docs/tutorials/tray.md": Sitting(
        (
            Typed("sed 's/", r"is up at http://127.0.0.1:8000", stays=True),
            Typed("python docs/examples/place.py", stays=True),
            Typed("python docs/examples/tray.py", r"series \S+ is completed", seconds=900.0),
        ),
        slow=True,
    ),
    "docs/tutorials/first-grip.md": Sitting(
        (
            Typed("pincette job grip --force-mN 10", r"succeeded: gripped"),
            Typed("pincette plan grip --force-mN 100", r"above the limit 40 mN", status=5),
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
            Typed("pincette plan calibrate noise", r"feasible"),
            Typed("pincette job calibrate noise", r"accepted, model 1", seconds=200.0),
            Typed("pincette job calibrate free_response", r"accepted, model 2", seconds=500.0),
            Typed("pincette rig part place", r"accepted, model 3", seconds=300.0),
            Typed("pincette model show", r"part\.stiffness_mN_per_um +\S+ mN/µm +20"),
            Typed("pincette plan grip", r"feasible"),
            Typed("pincette job grip", r"succeeded: gripped", seconds=200.0),
            Typed("pincette plan grip --force-mN 35", r"above the limit 30 mN", status=5),
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
            Typed("make demo", r"succeeded: gripped", seconds=120.0),
            Typed("pincette up --rig", r"is up at http://127.0.0.1:8000", stays=True),
            Typed("pincette job track --place", r"succeeded: tracked", seconds=90.0),
            Typed("pincette job grip --centre", r"succeeded: gripped", seconds=90.0),
            Typed(
                "pincette job grip --force-mN 12 --place-um",
                r"succeeded: gripped",
                seconds=90.0,
            ),
            Typed("pincette plan grip", r"arm 2: position", status=5),
        ),
        slow=True,
    ),
    "docs/how-to/plan.md": Sitting(
        (
            Typed("curl -s http://127.0.0.1:8000/api/v1/jobs", r'"feasible":true'),
            Typed("curl -s http://127.0.0.1:8000/api/v1/traj", r'"kind":"track"'),
        ),
        up=DEMO,
    ),
    "docs/how-to/rest.md": Sitting(
        (
            Typed("API=http", r'"feasible":true(.|\n)*"can_start":true'),
            Typed('curl -s --fail-with-body "$API/jobs?curves', r'"feasible":true', seconds=90.0),
            Typed("JOB=", r'"state":"succeeded"(.|\n)*"name":"samples\.parquet"', seconds=90.0),
            Typed("python -c", "x_um µm"),
            Typed('curl -s --fail-with-body "$API/jobs"', r'"state":"stopped"', seconds=90.0),
            Typed("curl -s --fail-with-body -X POST", r'"cause":"estop"'),
            Typed("curl -s --fail-with-body --retry", r'"acknowledged":true'),
        ),
        up=DEMO,
    ),
    "docs/how-to/quick-grip.md": Sitting(
        (Typed("pincette job grip --profile gentle", r"succeeded: gripped"),), up=DEMO
    ),
    "docs/how-to/recipes.md": Sitting(
        (Typed("curl -s http://127.0.0.1:8000/api/v1/recipes", r'"recipe":\{?.*bead-1mm'),), up=DEMO
    ),
    "docs/how-to/series.md": Sitting(
        (
            Typed("cat > plan.toml", r"6 jobs(.|\n)*completed(.|\n)*forces\.html", seconds=200.0),
            Typed("from pincette.client import Supervisor", r"completed 2 of 2", seconds=90.0),
        ),
        up=DEMO,
        slow=True,
    ),
    "docs/how-to/data-sheet.md": Sitting(
        (Typed("pincette data-sheet", r"sheet/datasheet\.json", seconds=400.0),),
        up=DEMO,
        slow=True,
    ),
    "docs/how-to/alarms.md": Sitting((Typed("pincette rigs demo", r"actuator\.latch"),), up=DEMO),
    "docs/how-to/scripted-faults.md": Sitting(
        (
            Typed("export PINCETTE_RIG=deploy/rigs/bring-up.toml", r"output heal: done"),
            Typed("curl --json", r'"what":"stuck"'),
        ),
        up=HANDS,
    ),
    "docs/how-to/secure.md": Sitting(
        (
            Typed("pincette security init"),
            Typed("pincette security issue"),
            Typed("pincette security add"),
            Typed("pincette security show", r"anna"),
            Typed("pincette security revoke", r"revoked: demo/estimator"),
        )
    ),
    "docs/how-to/rest-keys.md": Sitting((Typed("pincette key add cell-7", r"cell-7"),)),
    "docs/how-to/several-rigs.md": Sitting(
        (
            Typed("pincette up --rig deploy/rigs/left.toml", r"is up at", stays=True),
            Typed("pincette up --rig deploy/rigs/right.toml", r"is up", stays=True),
            Typed("pincette rigs", r"right"),
        ),
        slow=True,
    ),
    "docs/how-to/observe.md": Sitting(
        (
            Typed("curl -s --fail-with-body http://127.0.0.1:8000/metrics", r"pincette_"),
            Typed("pincette key add prometheus", r"prometheus"),
        ),
        up=DEMO,
    ),
    "docs/how-to/several-hosts.md": Sitting((Typed("pincette security init pki"),)),
}
