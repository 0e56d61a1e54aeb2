// The TypeScript SDK at a server over HTTP: node mcp_http.mjs URL KEY FORCE_MN
import { Client } from "@modelcontextprotocol/sdk/client/index.js";
import { StreamableHTTPClientTransport } from "@modelcontextprotocol/sdk/client/streamableHttp.js";

async function connected(url, key) {
  const client = new Client({ name: "a test", version: "1" });
  const requestInit = { headers: { Authorization: `Bearer ${key}` } };
  await client.connect(new StreamableHTTPClientTransport(new URL(url), { requestInit }));
  return client;
}

async function main(url, key, forceMN) {
  const [one, other] = [await connected(url, key), await connected(url, key)];
  const call = (client, name, args = {}) => client.callTool({ name, arguments: args });
  const { tools } = await one.listTools();
  const plan = (await call(one, "plan_grip", { force_mN: forceMN })).structuredContent;
  const refused = await call(other, "grip", { token: plan.token });
  const held = await call(one, "grip", { token: plan.token });
  const released = await call(other, "release");
  const without = await connected(url, "").then(() => null, (error) => error.message);
  console.log(JSON.stringify({
    tools: tools.map((tool) => tool.name).sort(),
    refused: [refused.isError, refused.content[0].text],
    held: held.structuredContent,
    part: released.structuredContent.part,
    without,
  }));
  await one.close();
  await other.close();
}

main(process.argv[2], process.argv[3], Number(process.argv[4])).then(
  () => process.exit(0),
  (error) => {
    console.error(error);
    process.exit(1);
  },
);
