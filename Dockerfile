# SPDX-License-Identifier: Apache-2.0
# Targets: server (default), client, trainer, test. `--build-arg DEBIAN=trixie` builds on Debian 13.
ARG DEBIAN=bookworm

FROM debian:${DEBIAN}-slim AS toolchain
COPY deploy/packages/build.txt /tmp/build.txt
RUN apt-get update -qq \
 && grep -v '^#' /tmp/build.txt | DEBIAN_FRONTEND=noninteractive xargs apt-get install -y -qq --no-install-recommends > /dev/null \
 && rm -rf /var/lib/apt/lists/*

# Every test: docker build --target test .
FROM toolchain AS test
WORKDIR /src
COPY . .
RUN make test

FROM toolchain AS build
WORKDIR /src
COPY . .
# One stage for all programs: the images share most of the sources.
RUN cmake --preset release -DHOLDFAST_TESTS=OFF > /dev/null && cmake --build build/release -j "$(make -s jobs)" \
 && cd build/release/bin \
 && /src/deploy/image/rootfs.sh --alone /rootfs/server holdfast-server holdfast-healthcheck holdfast-import \
 && /src/deploy/image/rootfs.sh /rootfs/client holdfast \
 && /src/deploy/image/rootfs.sh /rootfs/trainer holdfast-train holdfast-eval holdfast-synth holdfast-import

FROM debian:${DEBIAN}-slim AS runtime
RUN useradd --system --uid 10001 --user-group --no-create-home holdfast
ENV LANG=C.UTF-8

# The command line client: docker build --target client -t holdfast-client .
# docker run --user "$(id -u):$(id -g)" -v "$PWD:/data" holdfast-client track video.mp4 --server=host:50051 ...
FROM runtime AS client
COPY --from=build /rootfs/client /
RUN ldconfig && holdfast --version
USER holdfast
WORKDIR /data
ENTRYPOINT ["holdfast"]

# The training job: docker build --target trainer -t holdfast-trainer .
# docker run --user "$(id -u):$(id -g)" -v "$PWD:/data" holdfast-trainer --preset=small --out=/data/small ...
FROM runtime AS trainer
COPY --from=build /rootfs/trainer /
# A new volume takes the owner of the directory that it is mounted over; WORKDIR alone would make it root's.
RUN ldconfig && holdfast-train --version && install -d -o holdfast -g holdfast /data
USER holdfast
WORKDIR /data
ENTRYPOINT ["holdfast-train"]

# The tracking server: gRPC on 50051; /metrics, /healthz and /readyz on 9464. It holds its programs, the libraries that
# they load and the weights: no shell, and nobody's base image.
FROM scratch AS server
COPY --from=build /rootfs/server /
RUN ["holdfast-server", "--version"]
USER holdfast
EXPOSE 50051 9464
# Kubernetes uses its own probes: http GET /readyz and /healthz on 9464.
HEALTHCHECK --interval=10s --timeout=5s --start-period=30s CMD ["holdfast-healthcheck"]
ENTRYPOINT ["holdfast-server"]
