// SPDX-License-Identifier: Apache-2.0
// Follows one point through JPEG files and prints where it is, once that is final: node follow.js SERVER X Y FILE...
// No code is generated: the protocol is read from its .proto file.
'use strict';

const {once} = require('events');
const {readFile} = require('fs/promises');
const path = require('path');
const grpc = require('@grpc/grpc-js');
const loader = require('@grpc/proto-loader');

const PROTO = path.join(__dirname, '../../proto');

function connect(server) {
  const definition = loader.loadSync('holdfast/v1/point_tracking.proto',
                                     {includeDirs: [PROTO], keepCase: true, defaults: true, longs: Number});
  const {holdfast} = grpc.loadPackageDefinition(definition);
  return new holdfast.v1.PointTracking(server, grpc.credentials.createInsecure());
}

function print(run) {
  for (let i = 0; i < run.final_count; ++i) {
    console.log(run.first_frame + i, run.x[i].toFixed(2), run.y[i].toFixed(2), run.visible[i] ? 'visible' : 'hidden');
  }
}

// Waits while the server has no room: what is not written stays out of memory.
async function write(stream, message) {
  if (!stream.write(message)) await once(stream, 'drain');
}

async function send(stream, point, files) {
  await write(stream, {config: {encoding: 'FRAME_ENCODING_JPEG', points: [point]}});
  for (const [index, file] of files.entries()) {
    await write(stream, {frame: {index, data: await readFile(file)}});
  }
  stream.end();
}

async function main([server, x, y, ...files]) {
  const client = connect(server);
  const stream = client.Track();
  stream.on('data', (response) => (response.tracks ? response.tracks.runs : []).forEach(print));
  const ended = once(stream, 'end');  // rejects with the server's error
  await Promise.all([ended, send(stream, {id: 7, x: Number(x), y: Number(y)}, files)]);
  client.close();
}

main(process.argv.slice(2)).catch((error) => {
  console.error(error.message);
  process.exit(1);
});
