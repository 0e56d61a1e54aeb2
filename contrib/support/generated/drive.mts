// Grip, follow and stop by types that were generated from the OpenAPI document; print JSON.
// Compiled with the generated schema.d.ts beside it, and run as: node drive.mjs URL FORCE_MN SAMPLE

import createClient from "openapi-fetch";
import type { paths } from "./schema.js";

declare const process: { argv: string[] };
const WAIT_MS = 60_000;
const [url, force, sample] = process.argv.slice(2) as [string, string, string];
const client = createClient<paths>({ baseUrl: url });

function got<T>(answer: { data?: T; error?: unknown }): T {
  if (answer.data === undefined) throw new Error(JSON.stringify(answer.error));
  return answer.data;
}

async function sha256(content: ArrayBuffer): Promise<string> {
  const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", content));
  return [...digest].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

const made = got(await client.POST("/api/v1/jobs", {
  body: { kind: "grip", force_mN: Number(force), autostart: true },
}));
if (!("id" in made)) throw new Error("a plan");
const path = { job: made.id };
const deadline = Date.now() + WAIT_MS;
for (let seen = false; !seen;) {
  if (Date.now() > deadline) throw new Error("it never approached");
  const page = got(await client.GET("/api/v1/jobs/{job}/events/list", { params: { path } }));
  seen = page.events.some((event) => event.body["phase"] === "approach");
}
got(await client.POST("/api/v1/jobs/{job}/actions", { params: { path }, body: { type: "stop" } }));
const query = { wait: "recorded", timeout_s: 30 } as const;
const sums: Record<string, string> = {};
let state = "";
while (!("manifest.json" in sums)) { // the file that is written when all others are there
  if (Date.now() > deadline + WAIT_MS) throw new Error("no record");
  ({ state } = got(await client.GET("/api/v1/jobs/{job}", { params: { path, query } })));
  const found = got(await client.GET("/api/v1/jobs/{job}/artifacts", { params: { path } }));
  for (const one of found.artifacts) sums[one.name] = one.sha256;
}
const same: Record<string, boolean> = {};
for (const name of ["samples.parquet", "grip.png"]) {
  const found = got(await client.GET("/api/v1/jobs/{job}/artifacts/{name}/content", {
    params: { path: { ...path, name } }, parseAs: "arrayBuffer",
  }));
  same[name] = (await sha256(found)) === sums[name];
}
const table = got(await client.GET("/api/v1/jobs/export.parquet", {
  params: { query: { sample } }, parseAs: "arrayBuffer",
}));
console.log(JSON.stringify({ state, same, export: await sha256(table) }));
