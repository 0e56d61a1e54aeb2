// Follow a stream of events until EventSource does not connect again; print JSON.
// Run as: node event_source.mjs ADDRESS

import { EventSource } from "eventsource";

const ids = [];
const source = new EventSource(process.argv[2]);
const dispatch = source.dispatchEvent.bind(source);
source.dispatchEvent = (event) => { // for events of any name
  // An event without a number, such as progress, has that of the event before it.
  if (event.lastEventId && event.lastEventId !== ids.at(-1)) ids.push(event.lastEventId);
  return dispatch(event);
};
const alive = setInterval(() => {}, 1000); // a wait to reconnect alone does not keep Node running
source.addEventListener("error", ({ code }) => {
  if (source.readyState !== EventSource.CLOSED) return;
  clearInterval(alive);
  console.log(JSON.stringify({ ids, last: code }));
});
