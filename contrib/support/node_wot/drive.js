// The stock client of the Web of Things, by the Thing Description alone: node drive.js URL FORCE_MN [KEY]
"use strict";
const { Servient } = require("@node-wot/core");
const { HttpClientFactory, HttpsClientFactory } = require("@node-wot/binding-http");

async function main(url, forceMN, key) {
  const servient = new Servient();
  servient.addClientFactory(new HttpClientFactory());
  servient.addClientFactory(new HttpsClientFactory());
  const wot = await servient.start();
  const description = await wot.requestThingDescription(url);
  if (key) servient.addCredentials({ [description.id]: { token: key } });
  const thing = await wot.consume(description);
  const read = async (name, options) => (await thing.readProperty(name, options)).value();
  const call = async (name, input, options) => (await thing.invokeAction(name, input, options)).value();
  const { rig } = description.actions.start.input.oneOf[0].properties;
  const said = { title: description.title, phases: [], live: 0 };

  said.part = (await read("state")).part;
  const plan = await call("plan", { kind: "grip", force_mN: 500.0, rig: rig.const });
  said.feasible = plan.feasible;
  said.violation = plan.violations[0];
  said.refused = await call("start", { kind: "grip", force_mN: 500.0, rig: rig.const }).then(
    () => null,
    (error) => error.message,
  );
  const heard = async (data) => {
    const batch = await data.value();
    said.live += batch.seq.length;
    said.phases.push(batch.phase);
  };
  // Its subscription sends no headers, and so no key.
  const live = key ? null : await thing.subscribeEvent("live", heard);

  const grip = { kind: "grip", force_mN: forceMN, until_released: true, autostart: true, rig: rig.const };
  const job = { uriVariables: { job: (await call("start", grip)).id } };
  const held = await until(async () => {
    const now = (await read("job", job)).progress;
    return now && now.force_held_mN;
  });
  said.held_mN = held;
  await call("act", { type: "release" }, job);
  said.state = (await read("result", job)).state;
  if (live) await live.stop();

  const stopped = { uriVariables: { job: (await call("start", grip)).id } };
  await call("act", { type: "stop" }, stopped);
  said.stopped = (await read("result", stopped)).state;
  said.estop = (await call("estop")).acknowledged;
  said.latch = await until(async () => {
    const state = (await read("state")).latch.state;
    return state === "latched" && state;
  });
  said.latched = await call("start", grip).then(() => null, (error) => error.message);
  console.log(JSON.stringify(said));
  await servient.shutdown();
}

async function until(there) {
  for (let tries = 0; tries < 600; tries += 1) {
    const found = await there();
    if (found) return found;
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
  throw new Error("it never came");
}

main(process.argv[2], Number(process.argv[3]), process.argv[4]).then(
  () => process.exit(0),
  (error) => {
    console.error(error);
    process.exit(1);
  },
);
