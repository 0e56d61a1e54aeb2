// Samples and events of the rig as they come. One window of the browser that is seen holds the streams;
// every other one polls, so that the windows leave each other connections. A window that is hidden,
// closed or has crashed gives the lock back; a browser without locks or streams polls.

import { BASE, poll, RIG_PATH, heard } from "./api.js";

const KINDS = ["state", "phase", "action", "result", "alarm", "queue", "rig", "model", "series",
  "progress"];
const LOCK = "pincette:streams";
const AGAIN_MS = 5000;
const POLL_MS = 400;
const STREAMS = typeof EventSource === "function" && typeof AbortController === "function"
  && navigator.locks;
const EVENTS_EVERY = 4; // polls of samples to one of events

export class Feed {
  /** `begun`, `samples` and `event` are called with what comes. */
  constructor({ begun, samples, event }) {
    Object.assign(this, { begun, samples, event });
    this.sources = [];
    this.release = null; // ends the hold of the lock
    this.wanted = null; // cancels the request for the lock
    this.next = null; // place of the first sample that is not yet polled
    this.newest = null; // number of the newest event that is known
    this.polls = 0;
    document.addEventListener("visibilitychange", () => this.settle());
    addEventListener("pagehide", () => this.close());
    addEventListener("pageshow", () => this.settle());
    document.addEventListener("pincette:make-way", () => this.rest());
    begun();
    this.settle();
    this.poll();
  }

  /** Request the streams while the page is visible. */
  settle() {
    if (document.hidden) this.close();
    else if (!this.wanted && STREAMS) this.ask();
  }

  ask() {
    this.wanted = new AbortController();
    const held = () => new Promise((release) => {
      this.release = release;
      this.open();
    });
    navigator.locks.request(LOCK, { signal: this.wanted.signal }, held).catch(() => {});
  }

  open() {
    this.listen("live", (source) => {
      source.addEventListener("open", () => this.begun());
      source.addEventListener("message", ({ data }) => this.take(JSON.parse(data)));
    });
    this.listen("events", (source) => {
      for (const kind of KINDS) source.addEventListener(kind, ({ data }) => this.event(JSON.parse(data)));
    });
  }

  listen(name, wire) {
    const source = new EventSource(`${BASE}${RIG_PATH}/${name}`);
    source.addEventListener("error", () => source.readyState === EventSource.CLOSED && this.rest());
    wire(source);
    this.sources.push(source);
  }

  take(batch) {
    heard.sample = performance.now();
    this.samples(batch);
  }

  close() {
    clearTimeout(this.later);
    for (const source of this.sources.splice(0)) source.close();
    this.wanted?.abort();
    this.release?.();
    this.wanted = null;
    this.release = null;
    this.next = null;
    this.newest = null;
  }

  /** Close the streams, and request them again after a while. */
  rest() {
    this.close();
    this.wanted = { abort: () => {} }; // none is requested until then
    this.later = setTimeout(() => {
      this.wanted = null;
      this.settle();
    }, AGAIN_MS);
  }

  async poll() {
    if (!document.hidden && !this.sources.length) {
      try {
        await this.pollSamples();
        if (this.polls % EVENTS_EVERY === 0) await this.pollEvents();
        this.polls += 1;
      } catch (problem) {
        if (problem.status === undefined) throw problem;
        this.next = null;
      }
    }
    setTimeout(() => this.poll(), POLL_MS);
  }

  async pollSamples() {
    const { batches, next } = await poll(
      `${RIG_PATH}/samples${this.next === null ? "" : `?after=${this.next}`}`);
    if (this.sources.length) return; // a stream brings them now
    if (this.next === null) this.begun();
    this.next = next;
    batches.forEach((batch) => this.take(batch));
  }

  async pollEvents() {
    const from = this.newest === null ? "limit=1" : `after=${this.newest}`;
    const { events, newest } = await poll(`${RIG_PATH}/events/list?${from}`);
    if (this.newest !== null) events.forEach((event) => this.event(event));
    this.newest = Math.max(newest, ...events.map(({ number }) => number));
  }
}
