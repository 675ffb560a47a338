# planfit on CPUs: docker build -t planfit . && docker run --rm -v "$PWD":/data planfit demo -o /data/demo
FROM python:3.12-slim AS build
WORKDIR /source
COPY pyproject.toml hatch_build.py README.md LICENSE ./
COPY src src
RUN python -m venv /opt/planfit && /opt/planfit/bin/pip install --no-cache-dir . \
    && /opt/planfit/bin/planfit doctor --compile

FROM python:3.12-slim
COPY --from=build /opt/planfit /opt/planfit
# What was not compiled above, for want of a CPU that has it, is kept where any user may write (docker run --user).
RUN useradd --create-home planfit
USER planfit
ENV PATH=/opt/planfit/bin:$PATH HOME=/tmp NUMBA_CACHE_DIR=/tmp/planfit-numba
WORKDIR /data
ENTRYPOINT ["planfit"]
CMD ["--help"]
