// What node-wot does in one process after another: node hold.js URL grip|release|cancel [FORCE_MN PROCESS]
"use strict";
const { Servient } = require("@node-wot/core");
const { HttpClientFactory } = require("@node-wot/binding-http");

async function main(url, what, forceMN, supervisor) {
  const servient = new Servient();
  servient.addClientFactory(new HttpClientFactory());
  const wot = await servient.start();
  const description = await wot.requestThingDescription(url);
  const key = "hold.js";
  if (what === "cancel") {
    // A job is known by a header before it is there; a form may name headers.
    const header = { "htv:fieldName": "Idempotency-Key", "htv:fieldValue": key };
    description.actions.start.forms[0]["htv:headers"] = [header];
  }
  const thing = await wot.consume(description);
  const read = async (name, options) => (await thing.readProperty(name, options)).value();
  const call = async (name, input, options) => (await thing.invokeAction(name, input, options)).value();
  const grip = { kind: "grip", force_mN: forceMN, until_released: true, autostart: true };

  if (what === "grip") {
    console.log(JSON.stringify({ job: (await call("start", grip)).id }));
    await pause(60000); // it is killed meanwhile
  } else if (what === "release") {
    // A supervisor that was started again has no job of it: a job of its own lets it go.
    const { part, active_job } = await read("state");
    const release = { kind: "release", autostart: true };
    const id = active_job || (await call("start", release)).id;
    const job = { uriVariables: { job: id } };
    if (active_job) await call("act", { type: "release" }, job);
    console.log(JSON.stringify({ part, job: active_job, state: (await read("result", job)).state }));
  } else {
    process.kill(supervisor, "SIGSTOP");
    const started = call("start", grip).then((job) => job.id, (error) => error.message);
    await pause(500);
    const stopped = call("stopRequest", { idempotency_key: key }).then((done) => done.job);
    await pause(500);
    process.kill(supervisor, "SIGCONT");
    console.log(JSON.stringify({ stopped: await stopped, started: await started }));
  }
  await servient.shutdown();
}

function pause(ms) {
  return new Promise((resolve) => setTimeout(resolve, ms));
}

main(process.argv[2], process.argv[3], Number(process.argv[4]), Number(process.argv[5])).then(
  () => process.exit(0),
  (error) => {
    console.error(error);
    process.exit(1);
  },
);
