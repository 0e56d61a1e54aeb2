// Server-sent events. A page that nobody sees gives its connections back; a stream that the server
// refuses is tried again later, and the page polls meanwhile.

import { BASE, RIG_PATH, heard } from "./api.js";

const KINDS = ["state", "phase", "action", "result", "alarm", "queue", "rig", "model", "progress"];
const AGAIN_MS = 5000;

/** A stream that is open while the page is seen. */
class Stream {
  constructor(path, wire, opened = () => {}) {
    this.path = path;
    this.wire = wire;
    this.opened = opened;
    this.source = null;
    document.addEventListener("visibilitychange", () => this.settle());
    addEventListener("pagehide", () => this.close());
    this.settle();
  }

  settle() {
    if (document.hidden) this.close();
    else if (!this.source) this.open();
  }

  open() {
    clearTimeout(this.later);
    const source = new EventSource(this.path);
    this.source = source;
    source.addEventListener("open", () => this.opened());
    source.addEventListener("error", () => {
      if (source.readyState === EventSource.CLOSED) this.rest();
    });
    this.wire(source);
  }

  /** Close, and try again after a while. */
  rest() {
    this.close();
    this.later = setTimeout(() => this.settle(), AGAIN_MS);
  }

  close() {
    clearTimeout(this.later);
    this.source?.close();
    this.source = null;
  }
}

/** Follow the samples and the events of the rig. */
export function follow({ begun, samples, event }) {
  const live = new Stream(`${BASE}${RIG_PATH}/live`, (source) => {
    source.addEventListener("message", (message) => {
      heard.sample = performance.now();
      samples(JSON.parse(message.data));
    });
  }, begun);
  const events = new Stream(`${BASE}${RIG_PATH}/events`, (source) => {
    for (const kind of KINDS) {
      source.addEventListener(kind, (message) => event(JSON.parse(message.data)));
    }
  });
  document.addEventListener("pincette:make-way", () => {
    live.rest();
    events.rest();
  });
}
