// Forces by the Thing Description: node reach.js URL, then lines of JSON on the standard input,
// {"reach": FORCE_MN} or {"release": true}; each is answered by a line.
"use strict";
const readline = require("node:readline");
const { Servient } = require("@node-wot/core");
const { HttpClientFactory } = require("@node-wot/binding-http");

async function main(url) {
  const servient = new Servient();
  servient.addClientFactory(new HttpClientFactory());
  const wot = await servient.start();
  const thing = await wot.consume(await wot.requestThingDescription(url));
  const read = async (name, options) => (await thing.readProperty(name, options)).value();
  const call = async (name, input, options) => (await thing.invokeAction(name, input, options)).value();
  const of = (job) => ({ uriVariables: { job } });

  async function reach(forceMN) {
    const { part } = await read("state");
    const asked = { kind: part === "held" ? "hold" : "grip", force_mN: forceMN };
    const { id } = await call("start", { ...asked, until_released: true, autostart: true });
    for (;;) {
      const job = await read("job", of(id));
      if (job.ended_at) {
        const { state, cause } = await read("result", of(id));
        return { error: `job ${id} ${state}: ${cause}` };
      }
      const held = job.progress && job.progress.force_held_mN;
      if (held !== null && held !== undefined && job.state === "running") return { held };
      await new Promise((resolve) => setTimeout(resolve, 100));
    }
  }

  async function release() {
    const { active_job: job } = await read("state");
    await call("act", { type: "release" }, of(job));
    for (;;) {
      const { part, active_job: active } = await read("state");
      if (active === null) return { part };
      const { actions } = await read("job", of(job));
      if (actions[actions.length - 1].type === "stop") return { error: "the release was stopped" };
      await new Promise((resolve) => setTimeout(resolve, 100));
    }
  }

  for await (const line of readline.createInterface({ input: process.stdin })) {
    const asked = JSON.parse(line);
    console.log(JSON.stringify(asked.reach ? await reach(asked.reach) : await release()));
  }
  await servient.shutdown();
}

main(process.argv[2]).then(
  () => process.exit(0),
  (error) => {
    console.error(error);
    process.exit(1);
  },
);
