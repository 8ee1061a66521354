# make demo, make test: everything they need is set up in .venv first. PYTHON=... names the Python to make it with.

.DEFAULT_GOAL := help
.PHONY: help demo tester test lint types bench bench-quick soak collect coverage sync messages release-check test-lowest pictures clean setup-all setup-dev
export PYTHON
# The tests start hundreds of programs: none of them is to compile all modules again.
unexport PYTHONDONTWRITEBYTECODE

RUN := .venv/bin/python -m

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-13s %s\n", $$1, $$2 }' Makefile

demo: setup-all ## a client and a virtual RC8 talk, every packet explained / クライアントと仮想 RC8 の通信を見る
	@mkdir -p build && $(RUN) orinkit demo --picture build/motion.png

tester: setup-all ## the Tester in a browser, with a virtual RC8 / ブラウザで Tester と仮想 RC8 を使う
	@$(RUN) orinkit tester --virtual rc8

# Tests are selected by markers (pyproject.toml). Many of them wait, so there are more workers than cores.
# --no-loadscope-reorder keeps the slow files first (tests/conftest.py). collect compiles the tests once, before the workers start.
test: lint ## lint, types, and all tests but the long ones / 静的検査と全テスト (長時間のものを除く)
	@$(MAKE) --no-print-directory -j2 --output-sync=target types collect
	$(RUN) pytest -m "not soak" -n 7 --dist loadfile --no-loadscope-reorder
	ORINKIT_PURE=1 $(RUN) pytest -q -m "not soak" -n 7 --dist loadfile $(WITHOUT_C)

# The code that the extension in C replaces, and its users: these tests are run with and without it.
WITHOUT_C := tests/values/test_variant_bytes.py tests/bcap/test_client_core.py tests/bcap/test_direct_calls.py \
	tests/bcap/test_packet.py tests/bcap/test_server_core.py tests/client/test_bad_peers.py \
	tests/client/test_direct_path.py tests/client/test_objects.py tests/server/test_tcp_server.py

collect: setup-dev
	@$(RUN) pytest -q --collect-only -m "not soak" > /dev/null || true  # the tests report the error

lint: setup-dev ## style, layers, generated code / スタイル、層、生成コードの検査
	$(RUN) ruff check .
	$(RUN) ruff format --check .
	.venv/bin/lint-imports --no-logo
	.venv/bin/python tools/make_sync.py --check
	.venv/bin/python tools/messages.py --check
	.venv/bin/python tools/make_error_page.py --check
	.venv/bin/python tools/prose.py
	.venv/bin/python tools/duplicates.py

types: setup-dev ## mypy, strict / 型検査
	$(RUN) mypy

bench: setup-dev ## measurements, as ratios in one run / 性能測定 (同一実行内の比)
	@.venv/bin/python bench/bench.py
	@.venv/bin/python bench/stream.py
	@.venv/bin/python bench/tester.py

bench-quick: setup-dev ## what users call, in two minutes / 主な呼び出しの性能測定 (2 分)
	@.venv/bin/python bench/bench.py --quick --csv build/bench/quick.csv
	@.venv/bin/python bench/stream.py --cycles

soak: setup-dev ## the long tests / 長時間テスト
	$(RUN) pytest -m soak

# Without the extension in C, which would replace the functions to be covered.
coverage: setup-dev ## tests of the core; every branch of it must be covered / コアの分岐カバレッジ 100 %
	$(RUN) coverage erase
	ORINKIT_PURE=1 $(RUN) coverage run -m pytest -q -m "core and not soak" -n 2 --dist loadfile
	$(RUN) coverage combine -q
	$(RUN) coverage report --show-missing --skip-covered --fail-under=100

sync: setup-dev ## make the synchronous client again from the asynchronous one / 同期クライアントの再生成
	.venv/bin/python tools/make_sync.py

messages: setup-dev ## update the message catalogue from the source / メッセージカタログの更新
	.venv/bin/python tools/messages.py

pictures: setup-dev ## take the pictures of the Tester for README and docs / Tester の画面写真の再作成
	.venv/bin/python tools/pictures.py

.PHONY: codes
codes: setup-dev ## generate docs/error-codes.md from the table of return codes / リターンコード一覧の再生成
	.venv/bin/python tools/make_error_page.py

release-check: setup-dev ## build sdist and wheel, and test both in clean environments / 配布物 (sdist と wheel) の検査
	.venv/bin/python tools/release_check.py

test-lowest: setup-dev ## tests with the lowest versions of all dependencies / 依存パッケージの下限版でのテスト
	.venv/bin/python tools/lowest.py

clean: ## remove everything that was made, .venv too / 生成物を削除 (.venv を含む)
	rm -rf .venv build dist htmlcov .coverage .coverage.* .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find src tests tools bench -name __pycache__ -type d -prune -exec rm -rf {} +

setup-all setup-dev:
	@sh tools/setup.sh $(@:setup-%=%)
