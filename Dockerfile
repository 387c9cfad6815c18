# The book in a container: docker build --tag armsim . && docker run --name armsim armsim
# What it needs of the system; .devcontainer takes this stage.
FROM debian:13-slim AS system
# Debian keeps one version of a package, so there is none to pin.
# hadolint ignore=DL3008
RUN apt-get update && \
    apt-get install --yes --no-install-recommends ca-certificates chromium git make python3-venv && \
    rm -rf /var/lib/apt/lists/* && \
    useradd --uid 1000 --create-home --shell /bin/bash reader
USER 1000

# The locked environment, as everywhere, and the book.
FROM system
COPY --chown=1000 . /home/reader/armsim
WORKDIR /home/reader/armsim
RUN make install
CMD ["make", "book"]
