// The supervisor's REST interface. All addresses are relative to that of the page. A browser has six
// connections to one server for all its windows: one window alone holds two of them for streams.

import { setNow } from "./words.js";

/** Name of the page's rig. The supervisor has read it in the address, or chosen its own rig. */
export const RIG = document.documentElement.dataset.rig;
export const BASE = "api/v1";
export const RIG_PATH = `/rigs/${encodeURIComponent(RIG)}`;
const OF_RIG = `rig=${encodeURIComponent(RIG)}`;
const PATIENCE_MS = 20000;

/** When the rig's state and samples last came, by the browser's own clock; and what went wrong. */
export const heard = {
  rig: performance.now(), sample: performance.now(), ever: false, trouble: "",
};

/** A request that was refused, or not answered. `faults` are texts by field of the request. */
export class Problem extends Error {
  constructor(title, detail, status = 0, body = {}) {
    super(detail || title);
    this.title = title;
    this.status = status;
    this.body = body;
    this.faults = faultsOf([...(body.errors ?? []), ...(body.violations ?? [])]);
  }
}

/** What is wrong, by the field that each JSON pointer leads to. */
export function faultsOf(faults) {
  const found = new Map();
  for (const { pointer, message } of faults) {
    const field = String(pointer ?? "").split("/")[1] ?? "";
    found.set(field, found.has(field) ? `${found.get(field)}; ${message}` : message);
  }
  return found;
}

/** Requests of one sort, only so many of them on their way at once. */
class Lane {
  constructor(atOnce) {
    this.free = atOnce;
    this.waiting = [];
  }

  async enter() {
    if (this.free > 0) this.free -= 1;
    else await new Promise((go) => this.waiting.push(go));
  }

  leave() {
    const next = this.waiting.shift();
    if (next) next();
    else this.free += 1;
  }
}

const reading = new Lane(2);
const ordering = new Lane(1);
const polling = new Lane(1);

/** Fetch with a limit of time, where the browser can abort a request. */
export async function timedFetch(path, options) {
  const control = typeof AbortController === "function" ? new AbortController() : null;
  const timer = setTimeout(() => control?.abort(), PATIENCE_MS);
  try {
    const response = await fetch(path, { cache: "no-store", signal: control?.signal, ...options });
    return { response, text: await response.text() };
  } finally {
    clearTimeout(timer);
  }
}

/** Send a request; a path that begins with a slash is below that of the interface. */
async function send(lane, path, options) {
  await lane.enter();
  try {
    const { response, text } = await timedFetch(path.startsWith("/") ? BASE + path : path, options);
    setNow(response.headers.get("date"));
    const body = text ? JSON.parse(text) : {};
    if (response.status === 401) document.dispatchEvent(new CustomEvent("pincette:signed-out"));
    if (!response.ok) {
      throw new Problem(body.title ?? response.statusText, body.detail, response.status, body);
    }
    return body;
  } catch (error) {
    if (error instanceof Problem || typeof fetch !== "function") throw error;
    throw new Problem("The supervisor does not answer", `${error.message || error.name}`);
  } finally {
    lane.leave();
  }
}

const CLAIM = `pincette-claim-${RIG}`;
let secret = null;

/** Call a function of the storage of this tab, which a browser may forbid. */
function stored(name, ...values) {
  try {
    return sessionStorage[name](CLAIM, ...values);
  } catch {
    return null;
  }
}

/** The secret of this tab's claim on the rig, or null without one; `make` creates it. */
export function claimSecret(make) {
  secret ??= stored("getItem");
  if (make && secret === null) {
    secret = freshKey();
    stored("setItem", secret);
  }
  return secret;
}

export function forgetClaim() {
  secret = null;
  stored("removeItem");
}

function written(body, headers = {}) {
  const claim = claimSecret(false);
  return {
    method: "POST",
    headers: { "Content-Type": "application/json", ...(claim ? { "X-Claim": claim } : {}), ...headers },
    body: JSON.stringify(body),
  };
}

export const get = (path) => send(reading, path, {});

/** Read a resource that is polled; it waits for no other answer. */
export const poll = (path) => send(polling, path, {});

/** Order something; it waits for no answer that is merely read. */
export const post = (path, body, headers) => send(ordering, path, written(body, headers));

/** Change something in part. */
export const patch = (path, body) => send(ordering, path, { ...written(body), method: "PATCH" });

/** Claim, renew or give back; a claim that is given back needs its secret no more. */
export async function sendClaim(method, path, body) {
  const answer = await send(ordering, path, { ...written(body), method });
  if (method === "DELETE") forgetClaim();
  return answer;
}

/** Jobs of this rig, as `query` narrows them down; and what its calibrations propose. */
export const jobsOfRig = (query) => get(`/jobs?${OF_RIG}&${query}`);
export const seriesOfRig = (query) => get(`/series?${OF_RIG}&${query}`);
export const daysOfRig = () => get("page/days");
export const checklistOfRig = () => get(`${RIG_PATH}/checklist`);
export const calibrationsOfRig = (query) => get(`/calibrations?${OF_RIG}&${query}`);

/** What a job would do; nothing moves. */
export const planOf = (body, predict = true) => send(reading,
  `/jobs?dry_run=true&predict=${predict}`, written({ ...body, rig: RIG }));

/** Create a job of this rig that begins as soon as it may. */
export const startJob = (body, key = freshKey()) => post("/jobs",
  { ...body, rig: RIG, autostart: true }, { "Idempotency-Key": key });

/** Keep the plan of a request by its digest, create a job of it, and describe that. */
export async function startKept({ queue, on_stop, on_abort, ...body }, said, key) {
  const { digest } = await post("/trajectories", { ...body, rig: RIG });
  const job = await post(`/trajectories/${digest}/jobs`, { autostart: true, queue, on_stop, on_abort },
    { "Idempotency-Key": key });
  return Object.keys(said).length ? patch(`/jobs/${job.id}`, said) : job;
}

/** The rows of a file, read as the command line reads it. */
export const rowsOf = (file, columns) => send(reading, `page/points?columns=${columns}`,
  { method: "POST", headers: { "Content-Type": "application/octet-stream" }, body: file });

/** A key by which the same request sent twice makes one job. */
export function freshKey() {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  return `page-${[...bytes].map((byte) => byte.toString(16).padStart(2, "0")).join("")}`;
}

export const told = (problem) => (problem.title === problem.message ? problem.title
  : `${problem.title}: ${problem.message}`);
