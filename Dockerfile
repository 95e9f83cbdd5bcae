# Trocar in a container (docs/install.md):  docker build -t trocar .  and  docker run --rm -it trocar
ARG BASE=docker.io/library/debian:trixie-slim

FROM ${BASE} AS build
# hadolint ignore=DL3008
RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates gcc libc6-dev python3-venv
COPY . /src
RUN python3 -m venv /opt/trocar \
    && /opt/trocar/bin/pip wheel --no-cache-dir --no-deps -w /wheels /src \
    && set -- /wheels/*.whl \
    && /opt/trocar/bin/pip install --no-cache-dir -c /src/constraints.txt "$1[demo]" \
    && /opt/trocar/bin/pip uninstall -y pip

FROM ${BASE}
# libatomic1: memory order on ARM
# hadolint ignore=DL3008
RUN apt-get update && apt-get install -y --no-install-recommends libatomic1 python3 \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --uid 1000 --home-dir /var/lib/trocar --create-home trocar
COPY --from=build /opt/trocar /opt/trocar
ENV PATH=/opt/trocar/bin:$PATH TROCAR_STATE=/var/lib/trocar
USER 1000
WORKDIR /var/lib/trocar
VOLUME /var/lib/trocar
HEALTHCHECK --interval=10s --start-period=60s CMD ["trocar", "status"]
ENTRYPOINT ["trocar"]
CMD ["demo"]
