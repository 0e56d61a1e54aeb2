// The supervisor's REST interface. At most two requests are on their way at once: a browser has
// six connections to one server, and one must always be free for the e-stop.

export const RIG = document.body.dataset.rig;
export const BASE = "/api/v1";
const AT_ONCE = 2;
const PATIENCE_MS = 20000;

const waiting = [];
let flying = 0;

/** When requests and samples were last answered, by the browser's own clock. */
export const heard = { answer: performance.now(), sample: performance.now(), ever: false };

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

async function turn() {
  if (flying >= AT_ONCE) await new Promise((go) => waiting.push(go));
  flying += 1;
}

function leave() {
  flying -= 1;
  waiting.shift()?.();
}

async function send(path, options) {
  await turn();
  try {
    const signal = AbortSignal.timeout(PATIENCE_MS);
    const response = await fetch(BASE + path, { cache: "no-store", signal, ...options });
    heard.answer = performance.now();
    heard.ever = true;
    const text = await response.text();
    const body = text ? JSON.parse(text) : {};
    if (!response.ok) {
      throw new Problem(body.title ?? response.statusText, body.detail, response.status, body);
    }
    return body;
  } catch (error) {
    if (error instanceof Problem) throw error;
    throw new Problem("The supervisor does not answer", `${error.message || error.name}`);
  } finally {
    leave();
  }
}

export const get = (path) => send(path, {});

export function post(path, body, headers = {}) {
  return send(path, {
    method: "POST",
    headers: { "Content-Type": "application/json", ...headers },
    body: JSON.stringify(body),
  });
}

/** A key by which the same request sent twice makes one job. */
export function freshKey() {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  return `page-${[...bytes].map((byte) => byte.toString(16).padStart(2, "0")).join("")}`;
}
