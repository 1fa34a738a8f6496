# One image for every lacet service: what runs, from the same locked hashes as `make demo`, and lacet as a wheel.
# With LOCK=campaign.txt it has Dask as well, for docker-compose.campaign.yml.
FROM python:3.13-slim
ARG LOCK=run.txt

WORKDIR /build
COPY requirements requirements
RUN python -m pip install --no-cache-dir --require-hashes -r requirements/uv.txt \
 && python -m uv pip install --system --no-cache --require-hashes -r requirements/${LOCK}
COPY pyproject.toml README.md LICENSE NOTICE.md ./
COPY daq daq
COPY drivers drivers
COPY identify identify
COPY services services
COPY simulate simulate
COPY lacet lacet
RUN python -m uv pip install --system --no-cache --no-deps --no-build-isolation .

RUN useradd --create-home lacet && mkdir /runs /study && chown lacet /runs /study
USER lacet
WORKDIR /runs
CMD ["lacet", "--help"]
